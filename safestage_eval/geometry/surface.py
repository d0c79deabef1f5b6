"""Distances of triangle meshes that need not be convex, by python-fcl; and what lies inside one."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from .extent import reach
from .footprint import footprints
from .hull import hull_triangles
from .mover import Mover
from .polytope import CHORD_ERROR
from .pose import matrix
from .shape import PLANE, POINT, SEGMENT, BodyShape, Surface

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

ROUND_ERROR = {"cylinder": CHORD_ERROR, "ellipsoid": 2 * CHORD_ERROR}
"""m. Curved solids count as polyhedra within them, whose faces lie no deeper than this."""

CHUNK = 1 << 20
"""Point × triangle pairs held in memory at once."""


class _Part(NamedTuple):
    """A geom for python-fcl, from the body's bounding centre.

    Attributes:
        model: its triangles, or those of its core.
        margin: m, radius around a core.
        error: m, how far its surface may lie above the triangles.
    """

    model: Any
    margin: float
    error: float


def surface_distance(
    a: Mover, b: Mover, frames: I64, cap: float, *, flat: bool = False
) -> tuple[F64, F64]:
    """Bounds (N,) m at some frames on the distance of two bodies, one of them with a nonconvex mesh.

    Exact to rounding, or to ``ROUND_ERROR`` for each curved geom; flat ones to 0.1 mm. (cap, +inf)
    above the cap. A mesh is solid: what lies within it penetrates it. Where bodies penetrate, the
    upper bound is 0 and the lower one minus the overlap of their bounding boxes.
    """
    lower, upper = (_flat_distance if flat else _distance)(a, b, frames, cap)
    meets = np.flatnonzero(upper <= 0)
    if len(meets):
        rows = frames[meets]
        lower[meets] = -_box_overlap(a.at(rows), b.at(rows), flat)
    return lower, upper


def _flat_distance(a: Mover, b: Mover, frames: I64, cap: float) -> tuple[F64, F64]:
    if any(part is None for m in (a, b) for part in m.shape.polytopes):
        return np.full(len(frames), -np.inf), np.zeros(len(frames))
    apart = shapely.distance(footprints(a, frames), footprints(b, frames))
    near = apart < cap + 2 * CHORD_ERROR
    lower = np.where(near, np.minimum(apart - 2 * CHORD_ERROR, cap), cap)
    return lower, np.where(near, apart, np.inf)


def _distance(a: Mover, b: Mover, frames: I64, cap: float) -> tuple[F64, F64]:
    import fcl

    lower, upper = np.full(len(frames), cap), np.full(len(frames), np.inf)
    rows = a.rows(frames), b.rows(frames)
    turns = matrix(a.turn[rows[0]]), matrix(b.turn[rows[1]])
    centres = a.centre[rows[0]], b.centre[rows[1]]
    path = np.zeros(len(frames))
    for mover, row in zip((a, b), rows, strict=True):
        path[1:] += np.cumsum(mover.chord(row[1:], row[:-1]))
    for g, h in product(range(len(a.shape)), range(len(b.shape))):
        first, second = (_part(m.shape, i) for m, i in ((a, g), (b, h)))
        if first is None or second is None:
            continue
        error = first.error + second.error
        margin = first.margin + second.margin
        things = [fcl.CollisionObject(part.model) for part in (first, second)]
        last, since = -np.inf, -np.inf
        for t, way in enumerate(path.tolist()):
            limit = min(cap, upper[t])
            if last - (way - since) >= limit:
                continue
            if way > since:
                for thing, turn, centre in zip(things, turns, centres, strict=True):
                    thing.setTransform(fcl.Transform(turn[t], centre[t]))
                found = max(float(fcl.distance(*things)), 0.0) - margin
                last, since = found - error, way
            if last < limit:
                lower[t], upper[t] = min(lower[t], last), found
    _merge_planes(a, b, frames, lower, upper, cap)
    within = _contained(a, b, turns, centres)
    within |= _contained(b, a, turns[::-1], centres[::-1])
    upper[within] = np.minimum(upper[within], 0.0)
    return lower, upper


def _merge_planes(a: Mover, b: Mover, frames: I64, lower: F64, upper: F64, cap: float) -> None:
    """Merge the heights of each body over the other's planes into the bounds."""
    for one, other in ((a, b), (b, a)):
        for g in np.flatnonzero(one.shape.solids.kind == PLANE).tolist():
            some = one.at(frames)
            turn = matrix(some.orientation)
            normal = turn @ one.shape.solids.rotation[g][:, 2]
            foot = some.position + turn @ (one.shape.solids.offset[g] + one.shape.centre)
            height = -reach(other.at(frames), -normal) - (foot * normal).sum(1)
            near = np.broadcast_to(height, lower.shape) < np.minimum(cap, upper)
            height = np.broadcast_to(height, lower.shape)[near]
            lower[near], upper[near] = np.minimum(lower[near], height), height


@lru_cache(maxsize=256)
def _part(shape: BodyShape, g: int) -> _Part | None:
    """Geom g of a body; None for a plane."""
    solids, kind = shape.solids, shape.solids.kind[g]
    if kind == PLANE:
        return None
    if shape.geoms[g].kind == "mesh":
        order = [i for i, geom in enumerate(shape.geoms) if geom.kind == "mesh"]
        return _Part(_hierarchy(shape.surfaces[order.index(g)]), 0.0, 0.0)
    if kind in (POINT, SEGMENT):
        ends = np.array([-1.0, 1.0])[:, None] * solids.size[g] @ solids.rotation[g].T
        triangle = Surface(ends + solids.offset[g], np.array([[0, 1, 1]]))
        return _Part(_hierarchy(triangle), float(solids.margin[g]), 0.0)
    part = shape.polytopes[g]
    assert part is not None  # only planes have none
    vertices = part.vertices - shape.centre
    hull = hull_triangles(vertices)
    faces = np.array([part.faces[0][:3]]) if hull is None else hull.corners
    return _Part(
        _hierarchy(Surface(vertices, faces)), 0.0, ROUND_ERROR.get(shape.geoms[g].kind, 0.0)
    )


def _hierarchy(surface: Surface) -> Any:
    import fcl

    model = fcl.BVHModel()
    model.beginModel(len(surface.faces), len(surface.vertices))
    model.addSubModel(np.ascontiguousarray(surface.vertices), surface.faces.astype(np.int32))
    model.endModel()
    return model


def _contained(a: Mover, b: Mover, turns: tuple[F64, F64], centres: tuple[F64, F64]) -> Bool:
    """(N,) whether some geom of a, by a point of it, lies inside a mesh of b."""
    inside = np.zeros(len(centres[0]), np.bool_)
    solids = a.shape.solids
    for g in np.flatnonzero(solids.kind != PLANE).tolist() if b.shape.surfaces else ():
        seed = solids.offset[g]
        if len(solids.corners[g]):
            seed = seed + solids.rotation[g] @ solids.corners[g].points[0]
        world = turns[0] @ seed + centres[0] - centres[1]
        local = (world[:, None] @ turns[1])[:, 0]
        for surface in b.shape.surfaces:
            inside |= encloses(surface, local)
    return inside


def _box_overlap(a: Mover, b: Mover, flat: bool) -> F64:
    """(N,) m: the least move along a world axis that parts the two bounding boxes, at least 0."""
    axes = np.eye(3)[: 2 if flat else 3]
    sides = [reach(a, way) + reach(b, -way) for axis in axes for way in (axis, -axis)]
    return np.asarray(np.maximum(np.minimum.reduce(sides), 0.0))


def encloses(surface: Surface, points: F64) -> Bool:
    """(N,) whether points (N, 3) lie inside the mesh; in the mesh's own coordinates.

    By the winding number, the sum of the triangles' signed solid angles (van Oosterom & Strackee
    1983), above one half: a small hole in the mesh does not let the inside out.
    """
    inside = np.zeros(len(points), bool)
    low, high = surface.vertices.min(0), surface.vertices.max(0)
    near = np.flatnonzero(((points >= low) & (points <= high)).all(1))
    step = max(1, CHUNK // max(len(surface.faces), 1))
    corners = surface.vertices[surface.faces]
    for start in range(0, len(near), step):
        rows = near[start : start + step]
        a, b, c = (corners[None, :, i] - points[rows, None] for i in range(3))
        la, lb, lc = (np.sqrt((v * v).sum(-1)) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(-1)
        ab, bc, ca = (a * b).sum(-1), (b * c).sum(-1), (c * a).sum(-1)
        solid = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        inside[rows] = np.abs(solid.sum(1)) > np.pi
    return inside
