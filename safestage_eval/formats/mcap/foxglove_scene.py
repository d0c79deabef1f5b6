"""The bodies' shapes as a ``foxglove.SceneUpdate``, bound to the frames of ``/tf``."""

from __future__ import annotations

from typing import Any

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from safestage_eval.episode import Episode, Geom, Mesh
from safestage_eval.episode.scene_shapes import rotation_matrix

PLANE_SIZE = 4.0
"""m, edge of the square that stands for an unbounded plane."""

COLOURS = {
    "robot": (0.55, 0.57, 0.60, 1.0),
    "gripper": (0.25, 0.27, 0.30, 1.0),
    "object": (0.85, 0.55, 0.20, 1.0),
    "fixture": (0.75, 0.72, 0.66, 1.0),
    "region": (0.30, 0.60, 0.90, 0.25),
}
"""Kind of body → r, g, b, a in viewers."""


def to_scene(episode: Episode, nanoseconds: int) -> SceneUpdate:
    """Return one entity per body with its shapes, valid from a log time (ns) on."""
    update = SceneUpdate()
    for body in episode.header.bodies:
        entity = update.entities.add(id=body.name, frame_id=body.name, frame_locked=True)
        entity.timestamp.FromNanoseconds(nanoseconds)
        for geom in body.geoms:
            _add(entity, geom, episode, COLOURS[body.kind])
    return update


def _add(
    entity: SceneEntity, geom: Geom, episode: Episode, colour: tuple[float, float, float, float]
) -> None:
    size = geom.size
    match geom.kind:
        case "sphere" | "ellipsoid":
            radii = np.array(size if len(size) == 3 else size * 3)
            _place(entity.spheres.add(), geom, colour, 2 * radii)
        case "box":
            _place(entity.cubes.add(), geom, colour, 2 * np.array(size))
        case "plane":
            flat = np.array([PLANE_SIZE, PLANE_SIZE, 1e-3])
            _place(entity.cubes.add(), geom, colour, flat, np.array([0, 0, -5e-4]))
        case "cylinder" | "capsule":
            radius, half = size
            shape = entity.cylinders.add(bottom_scale=1, top_scale=1)
            _place(shape, geom, colour, 2 * np.array([radius, radius, half]))
            for end in (-half, half) if geom.kind == "capsule" else ():
                ball = 2 * np.array([radius] * 3)
                _place(entity.spheres.add(), geom, colour, ball, np.array([0, 0, end]))
        case "mesh" | "convex_mesh":
            mesh = episode.meshes[geom.mesh or ""]
            surface = entity.triangles.add()
            _place(surface, geom, colour)
            for x, y, z in mesh.vertices.astype(float):
                surface.points.add(x=x, y=y, z=z)
            surface.indices.extend(_triangles(mesh).ravel().tolist())


def _place(
    shape: Any,
    geom: Geom,
    colour: tuple[float, float, float, float],
    size: np.ndarray | None = None,
    offset: np.ndarray | None = None,
) -> None:
    """Pose, size (m, whole edges) and colour of a primitive; offset m in the geom frame."""
    position = np.asarray(geom.position, float)
    if offset is not None:
        position = position + rotation_matrix(geom.orientation) @ offset
    shape.pose.position.x, shape.pose.position.y, shape.pose.position.z = position
    o = shape.pose.orientation
    o.w, o.x, o.y, o.z = geom.orientation
    if size is not None:
        shape.size.x, shape.size.y, shape.size.z = size
    shape.color.r, shape.color.g, shape.color.b, shape.color.a = colour


def _triangles(mesh: Mesh) -> np.ndarray:
    """(F, 3) vertex indices; of the convex hull when the mesh is a bare set of points."""
    if len(mesh.faces) or len(mesh.vertices) < 4:
        return mesh.faces
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(mesh.vertices.astype(float)).simplices
    except QhullError:  # the points lie in a plane: no hull to show
        return mesh.faces
