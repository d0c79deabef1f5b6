"""Certified penetration depth of two convex geoms whose cores meet.

The depth is the length of the shortest move that parts them: the least, over unit directions n, of
the overlap h(n), where h is the support function of the Minkowski difference A − B. Van den Bergen
2001, "Proximity queries and penetration depth computation on 3D game objects": a polytope of
support points grows inside A − B, at its face nearest to the origin. The depth is at least that
face's height over the origin, because the polytope lies within A − B, and at most h of any
direction that was tried. Both are returned; the loop ends when they are close.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, kernel

from .hull import begin, grow, room_for_hull
from .support_function import Pair, difference, support_pair

F64 = NDArray[np.float64]

DEPTH_TOLERANCE = 1e-7
"""m, between the bounds at which the loop ends."""

CORNERS = 2048
"""Support points at most. Only round geoms around one axis need so many; there the interval may be
a little wider than DEPTH_TOLERANCE, and holds the depth as well."""


@kernel
def _support(pair: Pair, tall: float, x: float, y: float, z: float, points: F64, out: F64) -> float:
    """Write the core difference's point farthest along (x, y, z) into ``out``; return how far.

    All in the axes of a. Where the pair is flattened, the flat difference is made ``tall`` (m) both
    ways, so that it has a volume. ``points`` (2, 3): scratch.
    """
    support_pair(pair, x, y, z, points[0], points[1])
    difference(pair, points[0], points[1], out)
    if tall > 0.0:
        up = pair.up
        level = out[0] * up[0] + out[1] * up[1] + out[2] * up[2]
        rise = x * up[0] + y * up[1] + z * up[2]
        level -= tall if rise >= 0.0 else -tall
        for i in range(3):
            out[i] -= level * up[i]
    return float(x * out[0] + y * out[1] + z * out[2])


@allocating
def penetration_depth(pair: Pair, upper: float, enough: float, out: F64) -> None:
    """Write bounds on the depth of two geoms without their margins, (lower, upper) m, to ``out`` (2,).

    The cores must meet. ``upper`` (m) is a bound that is known already. It ends early when the depth
    is known to be at most ``enough`` (m).
    """
    up = pair.up
    flat = up[0] != 0.0 or up[1] != 0.0 or up[2] != 0.0
    size = pair.A.radius[pair.a] + pair.B.radius[pair.b]
    tall = 2.0 * size if flat else 0.0
    fuzz = 1e-15 * (size + tall)
    hull, points, w = room_for_hull(CORNERS), np.empty((2, 3)), np.empty(3)
    c, lower = hull.corners, 0.0
    # a tetrahedron: both ends of an axis, what is farthest from their line, and from that triangle
    d = np.zeros(3)
    reach = -1.0
    for axis in range(3):
        d[:] = 0.0
        d[axis] = 1.0
        high = _support(pair, tall, d[0], d[1], d[2], points, c[2])
        low = _support(pair, tall, -d[0], -d[1], -d[2], points, c[3])
        upper = min(upper, high, low)
        if high + low > reach:
            reach = high + low
            for i in range(3):
                c[0, i], c[1, i] = c[2, i], c[3, i]
    for corner in range(2, 4):
        ux, uy, uz = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
        if corner == 2:  # across the line, the way of the axis that it is least along
            least = 0
            if abs(uy) < abs(ux):
                least = 1
            if abs(uz) < min(abs(ux), abs(uy)):
                least = 2
            d[:] = 0.0
            d[least] = 1.0
            vx, vy, vz = uy * d[2] - uz * d[1], uz * d[0] - ux * d[2], ux * d[1] - uy * d[0]
        else:
            vx, vy, vz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
        best = 0.0
        for _ in range(2):
            x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            norm = math.sqrt(x * x + y * y + z * z)
            if norm == 0.0:
                break
            x, y, z = x / norm, y / norm, z / norm
            foot = c[0, 0] * x + c[0, 1] * y + c[0, 2] * z
            for sign in (-1.0, 1.0):
                far = _support(pair, tall, sign * x, sign * y, sign * z, points, w)
                upper = min(upper, far)
                if far - sign * foot > best:
                    best = far - sign * foot
                    c[corner] = w
            if corner == 3 or best > 1e-3 * reach:
                break
            vx, vy, vz = x, y, z  # the other way across
        if best <= fuzz:  # flat: the depth is at most its thickness
            out[0], out[1] = 0.0, max(upper, 0.0)
            return
    ux, uy, uz = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    vx, vy, vz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    side = (
        (uy * vz - uz * vy) * (c[3, 0] - c[0, 0])
        + (uz * vx - ux * vz) * (c[3, 1] - c[0, 1])
        + (ux * vy - uy * vx) * (c[3, 2] - c[0, 2])
    )
    if side > 0.0:
        for i in range(3):
            c[0, i], c[1, i] = c[1, i], c[0, i]
    begin(hull, np.arange(4))
    used, count = 4, 4
    while True:
        nearest = 0
        for f in range(1, used):
            if hull.height[f] < hull.height[nearest]:
                nearest = f
        lower = max(lower, hull.height[nearest])
        if upper - lower <= DEPTH_TOLERANCE or upper <= enough or count == CORNERS:
            break
        n = hull.normal[nearest]
        far = _support(pair, tall, n[0], n[1], n[2], points, c[count])
        upper = min(upper, far)
        if upper - lower <= DEPTH_TOLERANCE or far <= hull.height[nearest] + fuzz:
            break
        used = grow(hull, nearest, count, used, fuzz)
        if used < 0:
            break
        count += 1
    out[0], out[1] = min(lower, max(upper, 0.0)), max(upper, 0.0)
