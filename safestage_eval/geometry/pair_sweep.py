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

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Memory(NamedTuple):
    """What a sweep writes to; G and H are the numbers of geoms of the two bodies.

    Attributes:
        RA, RB: (3, 3) the bodies' rotations.
        R, p: (3, 3) and (3,) pose of a geom of b in the axes of one of a.
        gap: (3,) from one bounding centre to the other, world.
        up: (3,) the vertical in the axes of a geom of a, or zero.
        out: (2,) bounds on a distance.
        work: of the distance of two geoms.
        at_a, at_b: (G, H, 4, 3) the simplex with which each pair's last search ended.
        size: (G, H) its number of points.
        known: (G, H) m, the last lower bound of each pair, where the bodies' paths added up to
            known_path: (G, H) m.
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
    known: F64
    known_path: F64


@kernel
def block_bounds(
    ma: Motion, mb: Motion, radius_a: float, radius_b: float, flat: bool, out: F64
) -> None:
    """Write a lower bound (m) on the distance of two bodies within each block of frames, (K,)."""
    last_a, last_b = ma.low.shape[0] - 1, mb.low.shape[0] - 1
    for k in range(out.shape[0]):
        s, t = min(k, last_a), min(k, last_b)
        ball, box = 0.0, 0.0
        for i in range(2 if flat else 3):
            side = max(ma.low[s, i] - mb.high[t, i], mb.low[t, i] - ma.high[s, i])
            ball += max(side, 0.0) ** 2
            box += max(side - ma.extent[s, i] - mb.extent[t, i], 0.0) ** 2
        out[k] = math.sqrt(ball) - radius_a - radius_b
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
def _geom_bound(A: Packed, a: int, B: Packed, b: int, p: F64, R: F64) -> float:
    """Lower bound (m) by balls and boxes around two geoms; R, p pose of b in the axes of a.

    A ball whose centre is outside the other geom's box is apart from it, or sticks into it, by the
    centre's distance less the radius; a centre within the box proves nothing.
    """
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
def sweep(
    A: Packed,
    B: Packed,
    ma: Motion,
    mb: Motion,
    radius_a: float,
    radius_b: float,
    cap: float,
    slack: float,
    flat: bool,
    deep: bool,
    blocks: I64,
    block_bounds: F64,
    lower: F64,
    upper: F64,
    least: F64,
) -> None:
    """Merge the distance of two bodies into what is known so far.

    ``A``, ``B`` are their geoms; ``ma``, ``mb`` their motions, of T frames or 1; ``radius_a``,
    ``radius_b`` (m) those of the balls around their bounding centres. Distances above ``cap`` (m)
    are of no interest. Bounds may be widened by ``slack`` (m) to reuse them. ``flat`` measures
    projections onto the horizontal plane. ``deep`` asks for depths (gjk.geom_distance). ``blocks``
    (K,) are visited in this order; ``block_bounds`` (K,) bound the distance within each from below (m).

    ``lower``, ``upper`` (T,) bound the least distance of the pairs so far (m) and are updated; or,
    with ``least`` of three elements instead of none, it alone is: lower bound, upper bound and
    frame of the minimum so far over pairs and frames. What cannot be lower by more than ``slack``
    is then left out.
    """
    ga, gb = A.kind.shape[0], B.kind.shape[0]
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
    _visit(
        A,
        B,
        ma,
        mb,
        radius_a,
        radius_b,
        cap,
        slack,
        flat,
        deep,
        blocks,
        block_bounds,
        lower,
        upper,
        least,
        memory,
    )


@kernel
def _visit(
    A: Packed,
    B: Packed,
    ma: Motion,
    mb: Motion,
    radius_a: float,
    radius_b: float,
    cap: float,
    slack: float,
    flat: bool,
    deep: bool,
    blocks: I64,
    block_bounds: F64,
    lower: F64,
    upper: F64,
    least: F64,
    memory: Memory,
) -> None:
    """``sweep``, which hands over the memory."""
    frames = max(ma.centre.shape[0], mb.centre.shape[0])
    last_a, last_b = ma.centre.shape[0] - 1, mb.centre.shape[0] - 1
    seek = least.shape[0] > 0
    ga, gb = A.kind.shape[0], B.kind.shape[0]
    RA, RB, R, p, gap, up, out, work, at_a, at_b, size, known, known_path = memory
    low, high = -np.inf, np.inf
    before_path, before_frame, settled = 0.0, 0, False
    for index in range(blocks.shape[0]):
        k = blocks[index]
        if seek and block_bounds[index] >= least[1] - slack:
            continue
        for frame in range(k * BLOCK, min(frames, (k + 1) * BLOCK)):
            s, t = min(frame, last_a), min(frame, last_b)
            limit = least[1] - slack if seek else min(cap, upper[frame])
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
                        bound = known[a, b] - abs(path - known_path[a, b])
                        if bound >= bar:
                            low = min(low, bound)
                            continue
                        relative_pose(A, a, B, b, RA, RB, gap, R, p, work)
                        if flat:
                            for i in range(3):
                                up[i] = 0.0
                                for j in range(3):
                                    up[i] += A.rotation[a, j, i] * RA[2, j]
                            bound = -np.inf
                        else:
                            bound = _geom_bound(A, a, B, b, p, R)
                        if bound < bar:
                            n = size[a, b]
                            size[a, b] = geom_distance(
                                A,
                                a,
                                B,
                                b,
                                R,
                                p,
                                up,
                                at_a[a, b],
                                at_b[a, b],
                                n,
                                bar,
                                deep,
                                work,
                                out,
                            )
                            bound = out[0]
                            if bound < bar:
                                high = min(high, out[1])
                        known[a, b], known_path[a, b] = bound, path
                        low = min(low, bound)
                # what lies above the limit is loosely known, and good for this limit only
                before_path, before_frame, settled = path, frame, high <= limit
            if low - moved < limit:
                if seek:
                    least[0] = min(least[0], low - moved)
                    if high + moved < least[1]:
                        least[1], least[2] = high + moved, frame
                else:
                    lower[frame] = min(lower[frame], low - moved)
                    upper[frame] = min(upper[frame], high + moved)
