"""Certified distance between two convex geoms.

Gilbert, Johnson & Keerthi 1988, "A fast procedure for computing the distance between complex
objects in three-dimensional space": the distance of A and B is the distance of the origin from
their Minkowski difference A − B. Every step yields a point v of A − B, so the distance is at most
|v|, and a support point w in direction −v, so the distance is at least v·w/|v|. Both are returned;
the loop ends when they are TOLERANCE apart, whatever it did to get there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, helper, kernel

from .penetration import penetration_depth
from .shape import BOX, PLANE
from .simplex import nearest_weights
from .support_function import Pair, difference, support_pair, support_value

F64 = NDArray[np.float64]

TOLERANCE = 1e-10
"""m, between the bounds at which the loop ends."""

PROMISED = 1e-9
"""m, the widest interval returned without a second attempt from scratch."""

TOUCHING = 1e-13
"""m, core distance below which cores count as meeting: far above float64 rounding at 10 m."""

ITERATIONS = 128


class Scratch(NamedTuple):
    """Scratch memory of the kernels of this file, allocated once by their caller.

    Attributes:
        points: (4, 3) the simplex, in the axes of geom a.
        weights: (4, 4) barycentric.
        vectors: (4, 3).
        matrices: (2, 3, 3).
    """

    points: F64
    weights: F64
    vectors: F64
    matrices: F64


@allocating
def scratch() -> Scratch:
    """Allocate scratch memory."""
    return Scratch(np.zeros((4, 3)), np.zeros((4, 4)), np.zeros((4, 3)), np.zeros((2, 3, 3)))


@helper
def _flat_difference(pair: Pair, at_a: F64, at_b: F64, out: F64) -> None:
    """Like ``difference``, flattened along ``pair.up``."""
    difference(pair, at_a, at_b, out)
    up = pair.up
    level = out[0] * up[0] + out[1] * up[1] + out[2] * up[2]
    for i in range(3):
        out[i] -= level * up[i]


@helper
def core_distance(
    pair: Pair, at_a: F64, at_b: F64, n: int, stop: float, work: Scratch, out: F64
) -> int:
    """Bounds on the distance of two geoms without their margins; neither is a plane.

    ``at_a``, ``at_b`` (4, 3) hold the simplex to start from in their first n rows, in the axes of
    a and of b, and are updated; n = 0 is a cold start. Above ``stop`` (m) it ends early, and then
    the upper bound may be loose. ``out`` (2,) gets the lower and the upper bound, m; (−inf, 0)
    when the cores meet.

    Returns:
        The number of simplex points to start the next, similar query from.
    """
    points, weight = work.points, work.weights[0]
    sa, sb, w = work.vectors[0], work.vectors[1], work.vectors[2]
    for i in range(n):
        _flat_difference(pair, at_a[i], at_b[i], points[i])
    lower, upper = -np.inf, np.inf
    for _ in range(ITERATIONS):
        if n > 0:
            nearest_weights(points, n, work.weights)
            kept = 0
            x, y, z = 0.0, 0.0, 0.0
            for i in range(n):
                share = weight[i]
                if share > 0.0:
                    x += share * points[i, 0]
                    y += share * points[i, 1]
                    z += share * points[i, 2]
                    if kept != i:
                        for c in range(3):
                            points[kept, c] = points[i, c]
                            at_a[kept, c], at_b[kept, c] = at_a[i, c], at_b[i, c]
                    kept += 1
            n = kept
            v = math.sqrt(x * x + y * y + z * z)
            if n == 4 or v < TOUCHING:
                out[0], out[1] = -np.inf, 0.0
                return 0
            if v >= upper:
                break
            upper = v
        else:
            x, y, z = -pair.p[0], -pair.p[1], -pair.p[2]
        support_pair(pair, -x, -y, -z, sa, sb)
        _flat_difference(pair, sa, sb, w)
        if n > 0:
            lower = max(lower, (x * w[0] + y * w[1] + z * w[2]) / upper)
        gap = upper - lower
        if gap <= TOLERANCE or (lower >= stop and gap <= 0.2 * (lower - stop) + 1e-4):
            break
        repeated = False
        for i in range(n):
            same = points[i, 0] == w[0] and points[i, 1] == w[1] and points[i, 2] == w[2]
            repeated = repeated or same
        if repeated:
            break
        for c in range(3):
            points[n, c], at_a[n, c], at_b[n, c] = w[c], sa[c], sb[c]
        n += 1
    out[0], out[1] = min(lower, upper), upper
    return min(n, 3)


@helper
def _overlap(pair: Pair, d: F64, work: Scratch) -> float:
    """How far the cores must move apart along ±d, made level and of unit length; inf if d ∥ up."""
    R, p, up = pair.R, pair.p, pair.up
    level = d[0] * up[0] + d[1] * up[1] + d[2] * up[2]
    x, y, z = d[0] - level * up[0], d[1] - level * up[1], d[2] - level * up[2]
    norm = math.sqrt(x * x + y * y + z * z)
    if norm < 1e-6:
        return np.inf
    x, y, z = x / norm, y / norm, z / norm
    best = np.inf
    for _ in range(2):
        x, y, z = -x, -y, -z
        support_pair(pair, x, y, z, work.vectors[0], work.vectors[1])
        reach = work.vectors[0, 0] * x + work.vectors[0, 1] * y + work.vectors[0, 2] * z
        bx = -(R[0, 0] * x + R[1, 0] * y + R[2, 0] * z)
        by = -(R[0, 1] * x + R[1, 1] * y + R[2, 1] * z)
        bz = -(R[0, 2] * x + R[1, 2] * y + R[2, 2] * z)
        reach += work.vectors[1, 0] * bx + work.vectors[1, 1] * by + work.vectors[1, 2] * bz
        best = min(best, reach - (p[0] * x + p[1] * y + p[2] * z))
    return best


@kernel
def _overlap_depth(pair: Pair, work: Scratch) -> float:
    """Upper bound (m) on how far two meeting cores must move to come apart.

    The least overlap over the separating-axis candidates of two boxes (Gottschalk, Lin & Manocha
    1996, "OBBTree"): three axes each and their nine cross products, for which it is exact, as it
    is for points and segments; and the directions between centres, across either z axis too.
    """
    R, p, d, best = pair.R, pair.p, work.vectors[3], np.inf
    along = R[0, 2] * p[0] + R[1, 2] * p[1] + R[2, 2] * p[2]
    for axis in range(18):
        i, j = axis // 3 % 3, axis % 3
        for c in range(3):
            if axis < 9:
                d[c] = 0.0
            elif axis < 12:
                d[c] = 1.0 if c == j else 0.0
            elif axis < 15:
                d[c] = R[c, j]
            elif axis == 15:
                d[c] = p[c]
            elif axis == 16:
                d[c] = p[c] if c < 2 else 0.0
            else:
                d[c] = p[c] - along * R[c, 2]
        if axis < 9:
            k, m = (i + 1) % 3, (i + 2) % 3
            d[k], d[m] = -R[m, j], R[k, j]
        best = min(best, _overlap(pair, d, work))
    return best


@kernel
def _plane_distance(pair: Pair, work: Scratch, out: F64) -> None:
    """Bounds when a or b is a half-space; exact unless both are, or it is flattened aslant."""
    A, a, B, b, R, p, up = pair
    swap = A.kind[a] != PLANE
    if A.kind[a] == B.kind[b]:
        out[0], out[1] = -np.inf, 0.0
        return
    # the half-space's outward normal in the axes of the other geom, and that one's height over it
    if swap:
        level = R[0, 2] * up[0] + R[1, 2] * up[1] + R[2, 2] * up[2]
        x, y, z = R[0, 2], R[1, 2], R[2, 2]
        centre = -(p[0] * x + p[1] * y + p[2] * z)
        height = centre - support_value(A, a, -x, -y, -z, work.vectors[0])
    else:
        level = up[2]
        height = p[2] - support_value(B, b, -R[2, 0], -R[2, 1], -R[2, 2], work.vectors[0])
    if abs(level) > 1e-9:
        out[0], out[1] = -np.inf, 0.0
    else:
        out[0], out[1] = height, height


@helper
def geom_distance(
    pair: Pair, at_a: F64, at_b: F64, n: int, stop: float, deep: bool, work: Scratch, out: F64
) -> int:
    """Bounds on the signed distance of two geoms, margins included; planes too; arguments as core_distance.

    ``out`` gets (lower, upper), m, at most PROMISED apart unless the cores meet or the distance is
    above ``stop``. Where the cores meet, the signed distance is minus the penetration depth, the
    length of the shortest move that parts the two: known to PROMISED for boxes, capsules and
    spheres (not flattened); for all others to DEPTH_TOLERANCE if ``deep``, and else only to be at
    most minus the sum of the margins and at least minus the smallest overlap found.
    """
    A, a, B, b, up = pair.A, pair.a, pair.B, pair.b, pair.up
    if A.kind[a] == PLANE or B.kind[b] == PLANE:
        _plane_distance(pair, work, out)
        return 0
    margin = A.margin[a] + B.margin[b]
    for _ in range(2):
        warm = n > 0
        n = core_distance(pair, at_a, at_b, n, stop + margin, work, out)
        settled = out[1] - out[0] <= PROMISED or out[1] == 0.0 or out[0] >= stop + margin
        if settled or not warm:
            break
        n = 0
    if out[1] == 0.0:
        overlap = _overlap_depth(pair, work)
        exact = A.kind[a] <= BOX and B.kind[b] <= BOX
        if exact and up[0] == 0.0 and up[1] == 0.0 and up[2] == 0.0:
            out[0], out[1] = -overlap, -overlap
        elif deep and overlap > -(stop + margin):
            penetration_depth(pair, overlap, -(stop + margin), out)
            out[0], out[1] = -out[1], -out[0]
        else:
            out[0] = -overlap
    out[0] -= margin
    out[1] -= margin
    return n


@helper
def relative_pose(pair: Pair, RA: F64, RB: F64, gap: F64, work: Scratch) -> None:
    """Write the pose of geom b in the axes of geom a into the pair's R and p.

    ``RA``, ``RB`` (3, 3) are the bodies' rotations; ``gap`` (3,) leads from the bounding centre of
    A's body to that of B's, world.
    """
    A, a, B, b, R, p, _ = pair
    GA, GB = A.rotation[a], B.rotation[b]
    across, inner = work.matrices[0], work.matrices[1]
    for i in range(3):
        p[i] = -A.offset[a, i]
        for j in range(3):
            across[i, j] = RA[0, i] * RB[0, j] + RA[1, i] * RB[1, j] + RA[2, i] * RB[2, j]
            p[i] += RA[j, i] * gap[j]
    for i in range(3):
        for j in range(3):
            p[i] += across[i, j] * B.offset[b, j]
            inner[i, j] = (
                across[i, 0] * GB[0, j] + across[i, 1] * GB[1, j] + across[i, 2] * GB[2, j]
            )
    x, y, z = p[0], p[1], p[2]
    for i in range(3):
        p[i] = GA[0, i] * x + GA[1, i] * y + GA[2, i] * z
        for j in range(3):
            R[i, j] = GA[0, i] * inner[0, j] + GA[1, i] * inner[1, j] + GA[2, i] * inner[2, j]
