"""Certified distance between groups of moving bodies: every answer is an interval that holds it.

For convex geoms that are apart by more than 10 µm the interval is at most 1e-9 m wide (gjk.py).
Positive: apart. Zero or negative: touching or penetrating. What the pruning in pair_sweep.py leaves
out never changes an answer.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from .backend import foreign_pairs
from .extent import reach
from .gjk import PROMISED
from .mover import BLOCK, Mover, frame_count
from .pair_sweep import Query, Side, block_bounds, sweep
from .pose import matrix
from .shape import PLANE, Packed, chosen, triangles
from .surface import SurfacePair, encloses

F64 = NDArray[np.float64]

SLACK = 1e-5
"""m, the recommended slack: bodies at rest tremble by less, and no limit is meant more finely.
Where a limit lies within a widened interval, measure again without: ``Clearance.leaves_open``."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """Bounds on a distance over time.

    Attributes:
        lower: (T,) m, the distance is at least this.
        upper: (T,) m, and at most this; +inf where it is only known to be above the cap.
    """

    lower: F64
    upper: F64

    def leaves_open(self, limit: float) -> bool:
        """Whether slack may keep open, at some frame, on which side of a limit (m) it is."""
        open_ = (self.lower <= limit) & (limit <= self.upper)
        return bool((open_ & (self.upper - self.lower > PROMISED)).any())


def clearance_series(
    a: Sequence[Mover],
    b: Sequence[Mover],
    cap: float = np.inf,
    *,
    slack: float = 0.0,
    flat: bool = False,
    deep: bool = False,
    backend: str = "gjk",
) -> Clearance:
    """Least signed distance, per frame, between any body of a and any body of b.

    Args:
        a: a group of bodies, of T frames or 1 each.
        b: another. A body is not measured against itself; bodies without geoms do not count.
        cap: m. Where the distance is larger: lower = cap, upper = +inf. Within 1e-9 m of the cap
            either answer may be given. Small caps are fast.
        slack: m. Where bodies have hardly moved, repeat the last interval, widened on both sides
            by what they did move, at most by this. Makes trembling at rest cheap; 0 for none.
        flat: measure the distance of the projections onto the horizontal plane.
        deep: measure how deep bodies penetrate, not only that they do.
        backend: whose distances: our own, or for comparison those of another library, as it tells
            them (backend.py). ``flat`` ones are always our own.

    Returns:
        (T,) bounds. Where bodies penetrate, the signed distance is minus the depth of the deepest
        pair of geoms; the depth of a pair is the length of the shortest move that parts the two.
        It is held to 1e-7 m if ``deep``; if not, it lies anywhere between the bounds.

    Raises:
        ValueError: two bodies' lengths contradict each other.
        InputError: a backend that does not exist, or is not installed.
    """
    frames = frame_count(*a, *b)
    return clearance_pairs(
        product(a, b), frames, cap, slack=slack, flat=flat, deep=deep, backend=backend
    )


def clearance_pairs(
    pairs: Iterable[tuple[Mover, Mover]],
    frames: int,
    cap: float = np.inf,
    *,
    slack: float = 0.0,
    flat: bool = False,
    deep: bool = False,
    backend: str = "gjk",
) -> Clearance:
    """Like ``clearance_series``, over chosen pairs of bodies (a robot's own links, say); T = frames."""
    if backend != "gjk" and not flat:
        return _foreign(list(pairs), frames, cap, backend)
    query = Query(float(cap), float(slack), flat, deep)
    bounds = _unbounded(frames, query)
    for a, b in pairs:
        if a is b:
            continue
        if a.shape.surfaces or b.shape.surfaces:
            apart = _with_surfaces(a, b, query)
        elif frame_count(a, b) == frames:
            _merge(a, b, a.shape.solids, b.shape.solids, query, bounds)
            continue
        else:  # neither ever moves
            apart = _unbounded(1, query)
            _merge(a, b, a.shape.solids, b.shape.solids, query, apart)
        np.minimum(bounds.lower, apart.lower, out=bounds.lower)
        np.minimum(bounds.upper, apart.upper, out=bounds.upper)
    return bounds


def motion_bound(a: Mover, b: Mover | None = None) -> F64:
    """(T − 1,) m: how far any point of a moves, at most, from each frame to the next.

    With b, how much the distance between a and b can change at most: the sum of both. Assumes that
    between two frames the bounding centre goes straight and the body turns evenly by the smaller
    angle. If d and e are the distances at the two frames and m the bound, the distance in between
    is at least (d + e − m) / 2.
    """
    movers = [a] if b is None else [a, b]
    bound = np.zeros(frame_count(*movers) - 1)
    for mover in movers:
        if len(mover) > 1:
            bound += mover.steps
    return bound


def _foreign(pairs: list[tuple[Mover, Mover]], frames: int, cap: float, backend: str) -> Clearance:
    """(T,) as another library tells it; planes by their closed form where it takes none."""
    bounds = Clearance(*foreign_pairs(pairs, frames, cap, backend))
    for a, b in pairs if backend == "fcl" else []:
        for first, second in ((a, b), (b, a)):
            planes = first.shape.hulls.kind == PLANE
            if a is not b and planes.any():
                A, B = chosen(first.shape.hulls, planes), second.shape.hulls
                _merge(first, second, A, B, Query(float(cap), 0.0, False, False), bounds)
    return bounds


def _unbounded(frames: int, query: Query) -> Clearance:
    """(T,) bounds before anything is measured."""
    return Clearance(np.full(frames, query.cap), np.full(frames, np.inf))


def _block_bounds(a: Mover, b: Mover, flat: bool) -> F64:
    """(K,) m: lower bound on the distance of two bodies within each block of frames."""
    bounds = np.empty(-(-frame_count(a, b) // BLOCK))
    block_bounds(a.motion, b.motion, float(a.shape.radius + b.shape.radius), flat, bounds)
    return bounds


def _merge(a: Mover, b: Mover, A: Packed, B: Packed, query: Query, bounds: Clearance) -> None:
    """Merge the distance of geoms A of a and B of b into the bounds, (T,)."""
    near = _block_bounds(a, b, query.flat) < query.cap
    if near.any() and len(A.kind) and len(B.kind):
        one, other = (Side(g, m.motion, float(m.shape.radius)) for g, m in ((A, a), (B, b)))
        sweep(one, other, query, np.flatnonzero(near), bounds.lower, bounds.upper)


def _with_surfaces(a: Mover, b: Mover, query: Query) -> Clearance:
    """(T,) bounds for two bodies of which at least one has a nonconvex mesh.

    Triangles against convex geoms by GJK, against triangles by python-fcl (flat: by GJK). A mesh
    is solid: what lies within it penetrates it. Where bodies penetrate, the lower bound is minus
    the overlap of their bounding boxes.
    """
    frames = frame_count(a, b)
    bounds = _unbounded(frames, query)
    faces_a, faces_b = ([triangles(s) for s in m.shape.surfaces] for m in (a, b))
    jobs = [(a.shape.solids, b.shape.solids)]
    jobs += [(a.shape.solids, face) for face in faces_b]
    jobs += [(face, b.shape.solids) for face in faces_a]
    if query.flat:
        jobs += list(product(faces_a, faces_b))
    for A, B in jobs:
        _merge(a, b, A, B, query, bounds)
    if not query.flat:
        _mesh_distance(a, b, query.cap, bounds)
        within = _contained(a, b, frames) | _contained(b, a, frames)
        bounds.upper[within] = np.minimum(bounds.upper[within], 0.0)
    meets = bounds.upper <= 0
    if meets.any():
        rows = np.flatnonzero(meets)
        bounds.lower[rows] = -_box_overlap(a.at(rows), b.at(rows), query.flat)
    return bounds


def _mesh_distance(a: Mover, b: Mover, cap: float, bounds: Clearance) -> None:
    """Merge the distances of a's meshes to b's into the bounds, skipping what motion rules out."""
    if not (a.shape.surfaces and b.shape.surfaces):
        return
    frames = len(bounds.lower)
    near = _block_bounds(a, b, False)
    rotations = [matrix(m.orientation) for m in (a, b)]
    for sa, sb in product(a.shape.surfaces, b.shape.surfaces):
        pair, last, last_path = SurfacePair(sa, sb), -np.inf, 0.0
        for t in range(frames):
            i, j = t if len(a) > 1 else 0, t if len(b) > 1 else 0
            path = a.motion.path[i] + b.motion.path[j]
            limit = min(cap, bounds.upper[t])
            if near[t // BLOCK] >= limit or last - (path - last_path) >= limit:
                continue
            last = pair.distance(
                (rotations[0][i], a.motion.centre[i]), (rotations[1][j], b.motion.centre[j])
            )
            last_path = path
            if last < limit:
                bounds.lower[t] = min(bounds.lower[t], last)
                bounds.upper[t] = last


def _contained(a: Mover, b: Mover, frames: int) -> NDArray[np.bool_]:
    """(T,) whether the centre of some geom of a lies inside a mesh of b."""
    inside = np.zeros(frames, bool)
    if not b.shape.surfaces:
        return inside
    hulls = a.shape.hulls
    seeds = [hulls.offset[np.isfinite(hulls.radius) & (hulls.points == 0)]]
    seeds += [hulls.offset[[g]] + hulls.rotation[g] @ hulls.vertices[hulls.first[g]]
              for g in np.flatnonzero(hulls.points)]  # fmt: skip
    ra, rb = matrix(a.orientation), matrix(b.orientation)
    for seed in np.concatenate(seeds):
        world = ra @ seed + a.motion.centre
        local = np.einsum(
            "tij,ti->tj", np.broadcast_to(rb, (frames, 3, 3)), world - b.motion.centre
        )
        for surface in b.shape.surfaces:
            inside |= encloses(surface, np.broadcast_to(local, (frames, 3)))
    return inside


def _box_overlap(a: Mover, b: Mover, flat: bool) -> F64:
    """(T,) m: the least move along a world axis that parts the two bounding boxes, at least 0."""
    sides = []
    for axis in range(2 if flat else 3):
        for sign in (-1.0, 1.0):
            direction = sign * np.eye(3)[axis]
            sides.append(reach(a, direction) + reach(b, -direction))
    return np.asarray(np.maximum(np.minimum.reduce(sides), 0.0))
