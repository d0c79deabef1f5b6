"""Certified distance between groups of moving bodies: every answer is an interval that holds it.

For convex geoms that are apart by more than 10 µm the interval is at most 1e-9 m wide (gjk.py), for
nonconvex meshes as wide as surface.py says. Positive: apart. Zero or negative: touching or
penetrating. A frame or a pair of geoms is left out only when balls and boxes around them, or what is
nearer, prove that its distance cannot matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .gjk import PROMISED, Pairs, distances
from .mover import Mover, frame_count
from .penetration import DEPTH_TOLERANCE
from .pose import matrix
from .shape import stacked
from .surface import surface_distance

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

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

    Returns:
        (T,) bounds. Where bodies penetrate, the signed distance is minus the depth of the deepest
        pair of geoms; the depth of a pair is the length of the shortest move that parts the two.
        It is held to 1e-7 m, or the slack, if ``deep``; if not, it lies anywhere between the bounds.

    Raises:
        ValueError: two bodies' lengths contradict each other.
    """
    frames = frame_count(*a, *b)
    return clearance_pairs(product(a, b), frames, cap, slack=slack, flat=flat, deep=deep)


def clearance_pairs(
    pairs: Iterable[tuple[Mover, Mover]],
    frames: int,
    cap: float = np.inf,
    *,
    slack: float = 0.0,
    flat: bool = False,
    deep: bool = False,
) -> Clearance:
    """Like ``clearance_series``, over chosen pairs of bodies (a robot's own links, say); T = frames."""
    bounds = Clearance(np.full(frames, float(cap)), np.full(frames, np.inf))
    near = []
    for a, b in pairs:
        if a is b or not (len(a.shape) and len(b.shape)):
            continue
        if frame_count(a, b) not in (1, frames):
            raise ValueError(f"movers of {frame_count(a, b)} frames among {frames}")
        rows = _near_frames(a, b, cap, flat)
        if len(rows) and len(a) == len(b) == 1:
            rows = np.arange(frames)
        if a.shape.surfaces or b.shape.surfaces:
            apart = surface_distance(a, b, rows, cap, flat=flat)
            bounds.lower[rows] = np.minimum(bounds.lower[rows], apart[0])
            bounds.upper[rows] = np.minimum(bounds.upper[rows], apart[1])
        elif len(rows):
            near.append(_NearPair.of(a, b, rows, slack))
    if near:
        _measure(near, bounds, cap, slack, flat=flat, deep=deep)
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


def _near_frames(a: Mover, b: Mover, cap: float, flat: bool) -> I64:
    """The frames at which balls and world-aligned boxes around two bodies are nearer than the cap."""
    turns = a.turn, b.turn  # raises where one is no rotation
    rows = np.arange(max(len(a), len(b)))
    if not np.isfinite(a.shape.radius + b.shape.radius):
        return rows
    gap = b.centre - a.centre
    if flat:
        gap[:, 2] = 0.0
    rows = np.flatnonzero((gap * gap).sum(1) < max(cap + a.shape.radius + b.shape.radius, 0.0) ** 2)
    side = np.abs(gap[rows])
    for mover, turn in zip((a, b), turns, strict=True):
        side -= np.abs(matrix(turn[mover.rows(rows)])) @ mover.shape.half
    if flat:
        side[:, 2] = 0.0
    apart = np.sqrt((np.maximum(side, 0.0) ** 2).sum(1))
    # overlapping boxes say nothing about how deep a penetration is
    return np.asarray(rows[(apart < cap) | (apart == 0)])


WINDOWS = (512, 64, 8)
"""Frames, of which those where bodies are almost as in the first share its distance."""


class _NearPair(NamedTuple):
    """Two bodies at the frames at which they may be near.

    Attributes:
        a, b: the bodies.
        rows: (N,) the frames, and ``which`` (N,) of the leaders stands for each.
        leaders: (K,) frames to measure.
        moved: (N,) m, how much the distance differs at most from the leader's.
    """

    a: Mover
    b: Mover
    rows: I64
    which: I64
    leaders: I64
    moved: F64

    @classmethod
    def of(cls, a: Mover, b: Mover, rows: I64, slack: float) -> _NearPair:
        """Let frames share a leader where neither body has moved by more than the slack together."""
        every = np.arange(len(rows))
        first, moved = every.copy(), np.zeros(len(rows))
        if len(a) == len(b) == 1:
            first[:] = 0
        else:
            for window in WINDOWS:
                head = every // window * window
                alone = np.flatnonzero((first == every) & (first[head] == head) & (head != every))
                here, there = rows[alone], rows[head[alone]]
                way = a.chord(a.rows(here), a.rows(there)) + b.chord(b.rows(here), b.rows(there))
                near = way <= slack
                first[alone[near]], moved[alone[near]] = head[alone[near]], way[near]
        leaders, which = np.unique(first, return_inverse=True)
        return cls(a, b, rows, which, rows[leaders], moved)


class _Queries(NamedTuple):
    """Distances to measure: of which leader (over all pairs), of which geoms, and a lower bound, m."""

    leader: I64
    a: I64
    b: I64
    bound: F64


AT_ONCE = 1 << 18
"""Pairs of geoms whose bounds are held in memory at once."""


def _measure(
    near: list[_NearPair], bounds: Clearance, cap: float, slack: float, *, flat: bool, deep: bool
) -> None:
    """Merge the distances of pairs of convex bodies into the bounds: the likely nearest first."""
    start = np.cumsum([0, *(len(pair.leaders) for pair in near)])
    which = np.concatenate([pair.which + n for pair, n in zip(near, start, strict=False)])
    rows = np.concatenate([pair.rows for pair in near])
    moved = np.concatenate([pair.moved for pair in near])
    shapes = {id(m.shape): m.shape for pair in near for m in (pair.a, pair.b)}
    first = dict(zip(shapes, np.cumsum([0, *map(len, shapes.values())]).tolist(), strict=False))
    solids = stacked([shape.solids for shape in shapes.values()])
    turn_a, turn_b, gap = (np.concatenate(x) for x in zip(*map(_poses, near), strict=True))

    def limits() -> F64:
        """Up to which distance each leader's geoms matter."""
        out = np.full(start[-1], -np.inf)
        np.maximum.at(out, which, np.minimum(bounds.upper[rows], cap))
        return out + slack

    def pairs_of(leader: I64, a: I64, b: I64) -> Pairs:
        first, second = turn_a[leader], turn_b[leader]
        apart = gap[leader] + _turned(second, solids.offset[b]) - _turned(first, solids.offset[a])
        return Pairs(
            solids, a, b, first @ solids.rotation[a], second @ solids.rotation[b], apart, flat
        )

    tolerance = max(slack, DEPTH_TOLERANCE) if deep else None
    found, limit = [], limits()
    for n, pair in enumerate(near):
        many = len(pair.a.shape), len(pair.b.shape)
        step = max(AT_ONCE // (many[0] * many[1]), 1)
        for begin in range(0, len(pair.leaders), step):
            shape = min(step, len(pair.leaders) - begin), *many
            k, g, h = (x.ravel() for x in np.indices(shape))
            k += start[n] + begin
            g += first[id(pair.a.shape)]
            h += first[id(pair.b.shape)]
            bound = _geom_bounds(pairs_of(k, g, h))
            use = bound < limit[k]
            found.append(_Queries(k[use], g[use], h[use], bound[use]))
    queries = _Queries(*(np.concatenate(x) for x in zip(*found, strict=True)))
    chosen = _likely_nearest(queries, which, rows, len(bounds.lower))
    for some in (chosen, ~chosen):
        limit = limits()
        use = some & (queries.bound < limit[queries.leader])
        leader, a, b = queries.leader[use], queries.a[use], queries.b[use]
        low, high = distances(pairs_of(leader, a, b), limit[leader], tolerance)
        lower, upper = np.full(start[-1], np.inf), np.full(start[-1], np.inf)
        np.minimum.at(lower, leader, low)
        np.minimum.at(upper, leader, np.where(low < limit[leader], high, np.inf))
        low, high = lower[which] - moved, upper[which] + moved
        hit = low < np.minimum(bounds.upper[rows], cap)
        np.minimum.at(bounds.lower, rows[hit], low[hit])
        np.minimum.at(bounds.upper, rows[hit], high[hit])


def _likely_nearest(queries: _Queries, which: I64, rows: I64, frames: int) -> NDArray[np.bool_]:
    """Which queries have the least bound of some frame."""
    least = np.full(which.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, queries.leader, queries.bound)
    frame = np.full(frames, np.inf)
    np.minimum.at(frame, rows, least[which])
    leads = np.zeros(len(least), np.bool_)
    leads[which[least[which] == frame[rows]]] = True
    return np.asarray(leads[queries.leader] & (queries.bound == least[queries.leader]))


def _poses(pair: _NearPair) -> tuple[F64, F64, F64]:
    """(K, 3, 3) rotations of both bodies and (K, 3) m from one bounding centre to the other."""
    a, b = (m.rows(pair.leaders) for m in (pair.a, pair.b))
    turns = matrix(pair.a.turn[a]), matrix(pair.b.turn[b])
    return *turns, pair.b.centre[b] - pair.a.centre[a]


def _geom_bounds(pairs: Pairs) -> F64:
    """Lower bounds (N,) m on the distances of geoms, by balls and boxes around them; flat, by balls.

    A ball whose centre is outside the other geom's box is apart from it, or sticks into it, by the
    centre's distance less the radius; a centre within the box proves nothing.
    """
    a, b, p = pairs.a, pairs.b, pairs.gap
    radius, half = pairs.solids.radius, pairs.solids.half
    if pairs.flat:
        return np.asarray(np.hypot(p[:, 0], p[:, 1]) - radius[a] - radius[b])
    bound = np.sqrt((p * p).sum(1)) - radius[a] - radius[b]
    for turn, box, ball in ((pairs.turn_a, half[a], radius[b]), (pairs.turn_b, half[b], radius[a])):
        side = np.maximum(np.abs(_turned(turn.swapaxes(1, 2), p)) - box, 0.0)
        apart = np.sqrt((side * side).sum(1))
        bound = np.where(apart > 0, np.maximum(bound, apart - ball), bound)
    return np.asarray(bound)


def _turned(turn: F64, vectors: F64) -> F64:
    return np.asarray((turn @ vectors[:, :, None])[:, :, 0])
