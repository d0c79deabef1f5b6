"""The shapes of a scene as arrays, for checks over many contacts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .body import Body, Geom
from .mesh import Mesh

F64 = NDArray[np.float64]

SPHERE, BOX, CYLINDER, CAPSULE, ELLIPSOID, PLANE, MESH = range(7)
"""Codes of shapes; a mesh is given by a box around it."""

_CODES = {
    "sphere": SPHERE,
    "box": BOX,
    "cylinder": CYLINDER,
    "capsule": CAPSULE,
    "ellipsoid": ELLIPSOID,
    "plane": PLANE,
}


class BodyShapes(NamedTuple):
    """The shapes of one body.

    Attributes:
        kind: (G,) ``SPHERE``, ``BOX``, ….
        size: (G, 3) m, as ``Geom.size``; half sides of the box around a mesh.
        place: (G, 3) m, centres in the body frame.
        axes: (G, 3, 3) their axes in the body frame, as columns.
        radius: m, of the ball around the body frame's origin that holds all of them.
    """

    kind: NDArray[np.int32]
    size: F64
    place: F64
    axes: F64
    radius: float


_KNOWN: dict[int, tuple[Body, BodyShapes]] = {}
"""``id`` → bodies that were met lately: those of a task are the same objects in all of its episodes."""
_KEPT = 256


def body_shapes(body: Body, meshes: Mapping[str, Mesh]) -> BodyShapes | None:
    """Its shapes; None where it has none, or one of them is a mesh that is not at hand."""
    if id(body) in _KNOWN:  # which keeps it, so that nothing else has its id
        return _KNOWN[id(body)][1]
    if not body.geoms or any(g.mesh is not None and g.mesh not in meshes for g in body.geoms):
        return None
    found = _built(body, meshes)
    _KNOWN[id(body)] = body, found
    if len(_KNOWN) > _KEPT:
        del _KNOWN[next(iter(_KNOWN))]
    return found


def _built(body: Body, meshes: Mapping[str, Mesh]) -> BodyShapes:
    count = len(body.geoms)
    kind, size = np.zeros(count, np.int32), np.zeros((count, 3))
    place, axes = np.zeros((count, 3)), np.zeros((count, 3, 3))
    reach = np.zeros(count)
    for i, geom in enumerate(body.geoms):
        axes[i] = rotation_matrix(geom.orientation)
        place[i], kind[i] = geom.position, _CODES.get(geom.kind, MESH)
        if geom.mesh is not None:
            vertices = np.asarray(meshes[geom.mesh].vertices, np.float64)
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            size[i] = (high - low) / 2
            place[i] += axes[i] @ ((low + high) / 2)
        else:
            size[i, : len(geom.size)] = geom.size
        reach[i] = np.linalg.norm(place[i]) + _ball(geom, size[i])
    return BodyShapes(kind, size, place, axes, float(reach.max()))


def _ball(geom: Geom, size: F64) -> float:
    """Radius (m) of the ball around a shape's centre."""
    if geom.kind == "plane":
        return np.inf
    if geom.kind == "capsule":
        return float(size[0] + size[1])
    return float(size.max() if geom.kind in ("sphere", "ellipsoid") else np.linalg.norm(size))


def rotation_matrix(quaternion: tuple[float, ...]) -> F64:
    """(3, 3) the matrix of a unit quaternion wxyz."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def world_boxes(shapes: BodyShapes, turn: F64, place: F64) -> tuple[F64, F64]:
    """(G, 3) and (G, 3) m, lower and upper corners of the boxes around shapes, in the world.

    ``turn`` (3, 3) and ``place`` (3,): of the body. Of a plane it is its origin.
    """
    axes, kind = turn @ shapes.axes, shapes.kind[:, None]
    radius, length = shapes.size[:, :1], shapes.size[:, 1:2]
    along = np.abs(axes[:, :, 2])
    flat = (np.abs(axes) @ shapes.size[:, :, None])[:, :, 0]
    radii = np.where(kind == SPHERE, radius, shapes.size)
    curved = np.linalg.norm(axes * radii[:, None], axis=2)
    cylinder = radius * np.sqrt(np.maximum(1 - along**2, 0)) + length * along
    reach = np.select(
        [kind == CYLINDER, kind == CAPSULE, (kind == SPHERE) | (kind == ELLIPSOID)],
        [cylinder, radius + length * along, curved],
        flat,
    )
    centre = shapes.place @ turn.T + place
    return centre - reach, centre + reach


def volume(body: Body, shapes: BodyShapes) -> float:
    """m³, of all shapes together, where they overlap more than once; of a mesh, of its box."""
    total = 0.0
    for geom, (a, b, c) in zip(body.geoms, shapes.size.tolist(), strict=True):
        if geom.kind == "plane":
            return np.inf
        if geom.kind in ("sphere", "ellipsoid"):
            total += 4 / 3 * np.pi * (a**3 if geom.kind == "sphere" else a * b * c)
        elif geom.kind in ("cylinder", "capsule"):
            caps = 4 / 3 * np.pi * a**3 if geom.kind == "capsule" else 0.0
            total += 2 * np.pi * a * a * b + caps
        else:
            total += 8 * a * b * c
    return total
