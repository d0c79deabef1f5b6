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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, kernel

from .support_function import Pair, difference, support_pair

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

DEPTH_TOLERANCE = 1e-7
"""m, between the bounds at which the loop ends."""

CORNERS = 2048
"""Support points at most. Only round geoms around one axis need so many; there the interval may be
a little wider than DEPTH_TOLERANCE, and holds the depth as well."""

SLIVER = 1e-16
"""Squared sine of the angle below which a new triangle is given the plane of its neighbour."""


class Hull(NamedTuple):
    """A polytope that grows; N corners, up to F = 2 N triangles in rows that are used again.

    Attributes:
        corners: (N, 3) m.
        face: (F, 3) corners, counter-clockwise seen from outside.
        beyond: (F, 3) the face across the edge from each corner to the next.
        normal: (F, 3) unit, outward.
        height: (F,) m, of its plane over the origin; inf in rows at rest.
        mark: (F,) the corner that last saw the face.
        stack: (F,) and ``edges`` (F, 4): scratch, the faces seen and their outline.
        starts: (N,) scratch, the outline's edge from a corner.
        spare: (F + 1,) rows at rest, their number first.
    """

    corners: F64
    face: I64
    beyond: I64
    normal: F64
    height: F64
    mark: I64
    stack: I64
    edges: I64
    starts: I64
    spare: I64


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


@kernel
def _face(hull: Hull, f: int, i: int, j: int, k: int, beside: int) -> None:
    """Make f the triangle of corners i, j, k; a sliver takes over the plane of face ``beside``.

    The sliver lies on or above that plane, so its height is no less: the lower bound holds.
    """
    c, n = hull.corners, hull.normal[f]
    ux, uy, uz = c[j, 0] - c[i, 0], c[j, 1] - c[i, 1], c[j, 2] - c[i, 2]
    vx, vy, vz = c[k, 0] - c[i, 0], c[k, 1] - c[i, 1], c[k, 2] - c[i, 2]
    n[0], n[1], n[2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    # the two longest edges, so that a needle is told from a right angle
    u, v, w = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    most = max(u * v, v * w, w * u)
    hull.face[f, 0], hull.face[f, 1], hull.face[f, 2] = i, j, k
    if square <= SLIVER * most and beside >= 0:
        for x in range(3):
            n[x] = hull.normal[beside, x]
        hull.height[f] = hull.height[beside]
        return
    norm = math.sqrt(square)
    for x in range(3):
        n[x] = n[x] / norm if norm > 0.0 else 0.0
    hull.height[f] = min(
        n[0] * c[i, 0] + n[1] * c[i, 1] + n[2] * c[i, 2],
        n[0] * c[j, 0] + n[1] * c[j, 1] + n[2] * c[j, 2],
        n[0] * c[k, 0] + n[1] * c[k, 1] + n[2] * c[k, 2],
    )


@kernel
def _seen(hull: Hull, f: int, corner: int, fuzz: float) -> bool:
    """Whether a corner lies above the plane of face f."""
    n, c = hull.normal[f], hull.corners[corner]
    return bool(n[0] * c[0] + n[1] * c[1] + n[2] * c[2] > hull.height[f] + fuzz)


@kernel
def _grow(hull: Hull, first: int, corner: int, used: int, fuzz: float) -> int:
    """Add a corner that sees face ``first``; the number of face rows in use, or −1 if it cannot.

    The faces that it sees are replaced by a fan over their outline. Nothing has changed when the
    outline is not one simple loop.
    """
    # flood from the first face over all that the corner sees
    mark, stack, edges = hull.mark, hull.stack, hull.edges
    stack[0], gone, rim = first, 1, 0
    mark[first] = corner
    done = 0
    while done < gone:
        f = stack[done]
        done += 1
        for e in range(3):
            g = hull.beyond[f, e]
            if mark[g] == corner:
                continue
            if _seen(hull, g, corner, fuzz):
                mark[g] = corner
                stack[gone] = g
                gone += 1
            else:
                edges[rim, 0], edges[rim, 1] = hull.face[f, e], hull.face[f, (e + 1) % 3]
                edges[rim, 2] = g
                rim += 1
    if rim < 3:
        return -1
    # a loop passes every corner once: as many edges as corners, each starting one
    for r in range(rim):
        hull.starts[edges[r, 0]] = -1
    for r in range(rim):
        if hull.starts[edges[r, 0]] != -1:
            return -1
        hull.starts[edges[r, 0]] = r
    at, length = 0, 0
    while length <= rim:
        length += 1
        at = edges[at, 1]
        follow = hull.starts[at] if at >= 0 else -1
        if follow < 0 or edges[follow, 0] != at:
            return -1
        at = follow
        if at == 0:
            break
    rows = used + max(rim - gone - hull.spare[0], 0)
    if length != rim or rows > hull.height.shape[0]:
        return -1
    for r in range(rim):
        if r < gone:
            edges[r, 3] = stack[r]
        elif hull.spare[0] > 0:
            edges[r, 3] = hull.spare[hull.spare[0]]
            hull.spare[0] -= 1
        else:
            edges[r, 3] = used
            used += 1
    for r in range(rim):
        u, v, g, f = edges[r, 0], edges[r, 1], edges[r, 2], edges[r, 3]
        _face(hull, f, u, v, corner, g)
        mark[f] = -1
        follow = edges[hull.starts[v], 3]
        hull.beyond[f, 0], hull.beyond[f, 1] = g, follow
        hull.beyond[follow, 2] = f
        for e in range(3):
            if hull.face[g, e] == v and hull.face[g, (e + 1) % 3] == u:
                hull.beyond[g, e] = f
    for r in range(rim, gone):  # fewer faces than before: their rows rest
        hull.height[stack[r]] = np.inf
        hull.spare[0] += 1
        hull.spare[hull.spare[0]] = stack[r]
    return used


@allocating
def _hull(size: int) -> Hull:
    """Memory for a polytope of at most ``size`` corners."""
    faces = 2 * size
    return Hull(
        np.empty((size, 3)),
        np.empty((faces, 3), np.int64),
        np.empty((faces, 3), np.int64),
        np.empty((faces, 3)),
        np.empty(faces),
        np.full(faces, -1),
        np.empty(faces, np.int64),
        np.empty((faces, 4), np.int64),
        np.empty(size, np.int64),
        np.zeros(faces + 1, np.int64),
    )


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
    hull, points, w = _hull(CORNERS), np.empty((2, 3)), np.empty(3)
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
    for f in range(4):
        i, j, k = (f + 1) % 4, (f + 2) % 4, (f + 3) % 4
        if f % 2 == 0:
            i, j = j, i
        _face(hull, f, i, j, k, -1)
    for f in range(4):
        for e in range(3):
            i, j = hull.face[f, e], hull.face[f, (e + 1) % 3]
            for g in range(4):
                for h in range(3):
                    if hull.face[g, h] == j and hull.face[g, (h + 1) % 3] == i:
                        hull.beyond[f, e] = g
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
        used = _grow(hull, nearest, count, used, fuzz)
        if used < 0:
            break
        count += 1
    out[0], out[1] = min(lower, max(upper, 0.0)), max(upper, 0.0)
