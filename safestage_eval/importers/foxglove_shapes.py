"""Shapes out of Foxglove scenes: cubes, spheres, cylinders and triangles that stick to a frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from safestage_eval.episode import Geom, Mesh

UNREAD = ("arrows", "lines", "texts", "models", "axes")


def scene_geoms(
    entities: Iterable[Any], meshes: dict[str, Mesh]
) -> tuple[dict[str, tuple[Geom, ...]], list[str]]:
    """Return frame → the geoms of its entities, and descriptions of shapes that were left out.

    Meshes of triangles are added to ``meshes``.
    """
    geoms: dict[str, list[Geom]] = {}
    left_out = []
    for entity in entities:
        mine = geoms.setdefault(entity.frame_id.strip("/"), [])
        mine += _cubes(entity)
        mine += _spheres(entity)
        for cylinder in getattr(entity, "cylinders", ()):
            geom = _cylinder(cylinder)
            if geom is None:
                left_out.append(f"a cone or oval cylinder of {entity.id}")
            else:
                mine.append(geom)
        for triangles in getattr(entity, "triangles", ()):
            mesh = _mesh(triangles)
            if mesh is None:
                left_out.append(f"triangles of {entity.id}")
                continue
            meshes[mesh.key] = mesh
            mine.append(Geom(kind="mesh", mesh=mesh.key, **_place(triangles.pose)))
        left_out += [f"{kind} of {entity.id}" for kind in UNREAD if len(getattr(entity, kind, ()))]
    return {frame: tuple(own) for frame, own in geoms.items() if own}, left_out


def _cubes(entity: Any) -> Iterator[Geom]:
    for cube in getattr(entity, "cubes", ()):
        yield Geom(kind="box", size=tuple(s / 2 for s in _xyz(cube.size)), **_place(cube.pose))


def _spheres(entity: Any) -> Iterator[Geom]:
    for sphere in getattr(entity, "spheres", ()):
        radii = tuple(s / 2 for s in _xyz(sphere.size))
        if max(radii) - min(radii) < 1e-9:
            yield Geom(kind="sphere", size=radii[:1], **_place(sphere.pose))
        else:
            yield Geom(kind="ellipsoid", size=radii, **_place(sphere.pose))


def _cylinder(cylinder: Any) -> Geom | None:
    x, y, z = _xyz(cylinder.size)
    if x != y or cylinder.bottom_scale != 1 or cylinder.top_scale != 1:
        return None
    return Geom(kind="cylinder", size=(x / 2, z / 2), **_place(cylinder.pose))


def _mesh(triangles: Any) -> Mesh | None:
    points = np.array([_xyz(point) for point in triangles.points], np.float64).reshape(-1, 3)
    corners = np.array(triangles.indices, np.int64)
    if not len(corners):
        corners = np.arange(len(points))
    if len(corners) < 3 or len(corners) % 3 or corners.max() >= len(points):
        return None
    return Mesh.build(points, corners.reshape(-1, 3))


def _xyz(vector: Any) -> tuple[float, float, float]:
    return float(vector.x), float(vector.y), float(vector.z)


def _place(pose: Any) -> dict[str, Any]:
    q = pose.orientation
    turn = np.array([q.w, q.x, q.y, q.z], np.float64)
    length = math.hypot(*turn)  # squares of huge numbers would overflow
    turn = turn / length if length > 0 else np.array([1.0, 0, 0, 0])
    return {"position": _xyz(pose.position), "orientation": tuple(turn.tolist())}
