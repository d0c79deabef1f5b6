"""Two bodies along their poses: the kernel that decides which frames and geoms need a distance.

Nothing is approximated. A frame or a pair of geoms is left out only when a bound proves that its
distance cannot matter: boxes around blocks of frames, balls and boxes around bodies and geoms, and
the fact that no distance changes by more than the bodies have moved since it was last known.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, helper, kernel

from .gjk import Scratch, geom_distance, relative_pose, scratch
from .mover import BLOCK, Motion, chord, rotation_at
from .shape import Packed
from .support_function import Pair

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Side(NamedTuple):
    """One of the two bodies.

    Attributes:
        geoms: its geoms, or some of them.
        motion: of T frames or 1.
        radius: m, of the ball around its bounding centre.
    """

    geoms: Packed
    motion: Motion
    radius: float


class Query(NamedTuple):
    """Which distances are wanted, and how exactly.

    Attributes:
        cap: m, distances above it do not matter.
        slack: m, by which bounds may be widened to use them again.
        flat: measure projections onto the horizontal plane.
        deep: measure depths (``gjk.geom_distance``).
    """

    cap: float
    slack: float
    flat: bool
    deep: bool


class Memory(NamedTuple):
    """Scratch memory of a sweep; G and H are the numbers of geoms of the two bodies.

    Attributes:
        RA, RB: (3, 3) the bodies' rotations.
        R, p: (3, 3) and (3,) pose of a geom of b in the axes of one of a.
        gap: (3,) from one bounding centre to the other, world.
        up: (3,) the vertical in the axes of a geom of a, or zero.
        out: (2,) bounds on a distance.
        work: of the distance of two geoms.
        at_a, at_b: (G, H, 4, 3) the simplex with which each pair's last search ended.
        size: (G, H) its number of points.
        bound: (G, H) m, the last lower bound of each pair, where the bodies' paths added up to
            bound_path: (G, H) m.
    """

    RA: F64
    RB: F64
    R: F64
    p: F64
    gap: F64
    up: F64
    out: F64
    work: Scratch
    at_a: F64
    at_b: F64
    size: I64
    bound: F64
    bound_path: F64


@kernel
def block_bounds(ma: Motion, mb: Motion, radii: float, flat: bool, out: F64) -> None:
    """Write a lower bound (m) on the distance of two bodies within each block of frames, (K,).

    ``radii`` (m) is the sum of the radii of their balls.
    """
    last_a, last_b = ma.low.shape[0] - 1, mb.low.shape[0] - 1
    for k in range(out.shape[0]):
        s, t = min(k, last_a), min(k, last_b)
        ball, box = 0.0, 0.0
        for i in range(2 if flat else 3):
            side = max(ma.low[s, i] - mb.high[t, i], mb.low[t, i] - ma.high[s, i])
            ball += max(side, 0.0) ** 2
            box += max(side - ma.extent[s, i] - mb.extent[t, i], 0.0) ** 2
        out[k] = math.sqrt(ball) - radii
        # overlapping boxes say nothing about how deep a penetration is; balls do
        if box > 0.0:
            out[k] = max(out[k], math.sqrt(box))


@helper
def _balls_and_boxes(
    ma: Motion, mb: Motion, s: int, t: int, flat: bool, radii: float, gap: F64
) -> float:
    """Lower bound (m) on the distance of two bodies at frames s, t of theirs; ``gap`` (3,) too."""
    ball, box = 0.0, 0.0
    for i in range(3):
        gap[i] = mb.centre[t, i] - ma.centre[s, i]
        if i == 2 and flat:
            continue
        ball += gap[i] * gap[i]
        side = abs(gap[i]) - ma.extent[s // BLOCK, i] - mb.extent[t // BLOCK, i]
        if side > 0.0:
            box += side * side
    apart = math.sqrt(ball) - radii
    # overlapping boxes say nothing about how deep a penetration is; balls do
    return float(max(apart, math.sqrt(box)) if box > 0.0 else apart)


@helper
def _geom_bound(pair: Pair) -> float:
    """Lower bound (m) on the distance of two geoms, by balls and boxes around them.

    A ball whose centre is outside the other geom's box is apart from it, or sticks into it, by the
    centre's distance less the radius; a centre within the box proves nothing.
    """
    A, a, B, b, R, p, _ = pair
    first, second, centres = 0.0, 0.0, 0.0
    for i in range(3):
        centres += p[i] * p[i]
        side = abs(p[i]) - A.half[a, i]
        if side > 0.0:
            first += side * side
        back = R[0, i] * p[0] + R[1, i] * p[1] + R[2, i] * p[2]
        side = abs(back) - B.half[b, i]
        if side > 0.0:
            second += side * side
    bound = math.sqrt(centres) - A.radius[a] - B.radius[b]
    if first > 0.0:
        bound = max(bound, math.sqrt(first) - B.radius[b])
    if second > 0.0:
        bound = max(bound, math.sqrt(second) - A.radius[a])
    return float(bound)


@allocating
def sweep(a: Side, b: Side, query: Query, blocks: I64, lower: F64, upper: F64) -> None:
    """Merge the distance of two bodies into the bounds so far.

    ``blocks`` (K,) are the blocks of frames to visit. ``lower``, ``upper`` (T,) bound the least
    distance of the pairs so far (m) and are updated.
    """
    ga, gb = a.geoms.kind.shape[0], b.geoms.kind.shape[0]
    memory = Memory(
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty(3),
        np.empty(3),
        np.zeros(3),
        np.empty(2),
        scratch(),
        np.zeros((ga, gb, 4, 3)),
        np.zeros((ga, gb, 4, 3)),
        np.zeros((ga, gb), np.int64),
        np.full((ga, gb), -np.inf),
        np.zeros((ga, gb)),
    )
    _visit(a, b, query, blocks, lower, upper, memory)


@kernel
def _visit(
    one: Side, other: Side, query: Query, blocks: I64, lower: F64, upper: F64, memory: Memory
) -> None:
    """Do the work of ``sweep``, without allocating."""
    A, ma, radius_a = one
    B, mb, radius_b = other
    cap, slack, flat, deep = query
    frames = max(ma.centre.shape[0], mb.centre.shape[0])
    last_a, last_b = ma.centre.shape[0] - 1, mb.centre.shape[0] - 1
    ga, gb = A.kind.shape[0], B.kind.shape[0]
    RA, RB, R, p, gap, up, out, work, at_a, at_b, size, bounds, bound_path = memory
    low, high = -np.inf, np.inf
    before_path, before_frame, settled = 0.0, 0, False
    for k in blocks:
        for frame in range(k * BLOCK, min(frames, (k + 1) * BLOCK)):
            s, t = min(frame, last_a), min(frame, last_b)
            limit = min(cap, upper[frame])
            path = ma.path[s] + mb.path[t]
            moved = abs(path - before_path)
            if low - moved >= limit:
                continue
            if low >= limit:
                s0, t0 = min(before_frame, last_a), min(before_frame, last_b)
                if low - chord(ma, radius_a, s, s0) - chord(mb, radius_b, t, t0) >= limit:
                    continue
            if settled and moved > slack > 0.0:
                s0, t0 = min(before_frame, last_a), min(before_frame, last_b)
                moved = chord(ma, radius_a, s, s0) + chord(mb, radius_b, t, t0)
            if moved > slack or not settled:
                moved = 0.0
                if _balls_and_boxes(ma, mb, s, t, flat, radius_a + radius_b, gap) >= limit:
                    continue
                rotation_at(ma.orientation, s, RA)
                rotation_at(mb.orientation, t, RB)
                low, high = np.inf, np.inf
                for a in range(ga):
                    for b in range(gb):
                        bar = min(limit, high)
                        bound = bounds[a, b] - abs(path - bound_path[a, b])
                        if bound >= bar:
                            low = min(low, bound)
                            continue
                        pair = Pair(A, a, B, b, R, p, up)
                        relative_pose(pair, RA, RB, gap, work)
                        if flat:
                            for i in range(3):
                                up[i] = 0.0
                                for j in range(3):
                                    up[i] += A.rotation[a, j, i] * RA[2, j]
                            bound = -np.inf
                        else:
                            bound = _geom_bound(pair)
                        if bound < bar:
                            n = size[a, b]
                            size[a, b] = geom_distance(
                                pair, at_a[a, b], at_b[a, b], n, bar, deep, work, out
                            )
                            bound = out[0]
                            if bound < bar:
                                high = min(high, out[1])
                        bounds[a, b], bound_path[a, b] = bound, path
                        low = min(low, bound)
                # a distance above the limit is loosely bounded, and good for this limit only
                before_path, before_frame, settled = path, frame, high <= limit
            if low - moved < limit:
                lower[frame] = min(lower[frame], low - moved)
                upper[frame] = min(upper[frame], high + moved)
