"""A naive evaluator: every frame, every pair of shapes, by python-fcl.

No pruning, no warm start, no memory of the last frame. The yardstick for speed, and, where
python-fcl is right, for the verdict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import fcl
import numpy as np

from safestage_eval.episode import Episode, Geom, Mesh
from safestage_eval.geometry.pose import matrix

Shapes = list[tuple[Any, np.ndarray, np.ndarray]]


def distances(
    episode: Episode, first: Sequence[str], second: Sequence[str], every: int = 1
) -> dict[tuple[str, str], np.ndarray]:
    """(body, body) → (T / every,) m: python-fcl's distance at every Nth frame; −1 in contact."""
    shapes = {name: _shapes(episode, name) for name in {*first, *second}}
    tracks = {name: episode.track(name) for name in shapes}
    frames = range(0, len(episode), every)
    found = {(a, b): np.empty(len(frames)) for a in first for b in second if a != b}
    for row, frame in enumerate(frames):
        placed = {}
        for name, parts in shapes.items():
            track = tracks[name]
            turn, origin = matrix(track.orientation[frame]), track.position[frame]
            placed[name] = [
                fcl.CollisionObject(s, fcl.Transform(turn @ r, turn @ p + origin))
                for s, r, p in parts
            ]
        for (a, b), series in found.items():
            series[row] = min(
                fcl.distance(x, y, fcl.DistanceRequest()) for x in placed[a] for y in placed[b]
            )
    return found


def _shapes(episode: Episode, name: str) -> Shapes:
    """(shape, rotation, position in the body frame) of a body's geoms."""
    return [
        (solid(geom, episode.meshes), matrix(geom.orientation), np.array(geom.position))
        for geom in episode.bodies[name].geoms
        if geom.kind != "plane"
    ]


def solid(geom: Geom, meshes: Mapping[str, Mesh]) -> Any:
    """A geom of any kind but a plane, about its own centre."""
    size = geom.size
    if geom.kind == "sphere":
        return fcl.Sphere(size[0])
    if geom.kind == "box":
        return fcl.Box(*(2 * s for s in size))
    if geom.kind == "cylinder":
        return fcl.Cylinder(size[0], 2 * size[1])
    if geom.kind == "capsule":
        return fcl.Capsule(size[0], 2 * size[1])
    if geom.kind == "ellipsoid":
        return fcl.Ellipsoid(*size)
    points = meshes[geom.mesh or ""].vertices.astype(float)
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    index = np.full(len(points), -1)
    index[hull.vertices] = np.arange(len(hull.vertices))
    faces = index[hull.simplices]
    corners = points[hull.vertices]
    inward = np.einsum("ij,ij->i", hull.equations[:, :3], np.cross(
        *(corners[faces[:, k]] - corners[faces[:, 0]] for k in (1, 2))
    )) < 0  # fmt: skip
    faces[inward] = faces[inward][:, ::-1]
    return fcl.Convex(corners, len(faces), np.column_stack([np.full(len(faces), 3), faces]).ravel())
