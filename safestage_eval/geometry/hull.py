"""The convex hull of points in space, as triangles.

A polytope grows until it holds all points; a kernel then checks that none lies outside.
Where rounding would decide, and for points that are flat, Qhull is asked instead; importing it takes
a quarter of the time to a process's first verdict, and meshes of robots do not need it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, kernel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

FUZZ = 1e-14
"""Share of the size of the points by which a point lies outside a face that it adds to."""

OUTSIDE = 1e-12
"""Share of that size by which a point may lie outside the hull."""

SLIVER = 1e-16
"""Squared sine of the angle below which a new triangle is given the plane of its neighbour."""

FLAT = 1e-7
"""Share of that size below which the points are flat."""


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
def add_face(hull: Hull, f: int, i: int, j: int, k: int, beside: int) -> None:
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
def begin(hull: Hull, corner: I64) -> None:
    """Make the first four faces, of four corners; the fourth lies below the plane of the others."""
    for f in range(4):
        i, j, k = (f + 1) % 4, (f + 2) % 4, (f + 3) % 4
        if f % 2 == 0:
            i, j = j, i
        add_face(hull, f, corner[i], corner[j], corner[k], -1)
    for f in range(4):
        for e in range(3):
            i, j = hull.face[f, e], hull.face[f, (e + 1) % 3]
            for g in range(4):
                for h in range(3):
                    if hull.face[g, h] == j and hull.face[g, (h + 1) % 3] == i:
                        hull.beyond[f, e] = g


@kernel
def sees(hull: Hull, f: int, corner: int, fuzz: float) -> bool:
    """Whether a corner lies above the plane of face f."""
    n, c = hull.normal[f], hull.corners[corner]
    return bool(n[0] * c[0] + n[1] * c[1] + n[2] * c[2] > hull.height[f] + fuzz)


@kernel
def grow(hull: Hull, first: int, corner: int, used: int, fuzz: float) -> int:
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
            if sees(hull, g, corner, fuzz):
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
        add_face(hull, f, u, v, corner, g)
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
def room_for_hull(size: int) -> Hull:
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


class Triangles(NamedTuple):
    """The F outward triangles of a hull.

    Attributes:
        corners: (F, 3) rows of the points, counter-clockwise seen from outside.
        planes: (F, 4) outward unit normal, and minus the plane's height over the origin (m).
    """

    corners: I64
    planes: F64


def hull_triangles(points: F64) -> Triangles | None:
    """The hull of points (N, 3) m; None where they are flat."""
    if len(points) > 3:
        middle = (points.min(0) + points.max(0)) / 2
        centred = np.ascontiguousarray(points - middle)
        corners, planes = np.empty((2 * len(points), 3), np.int64), np.empty((2 * len(points), 4))
        count = _wrap(centred, float(np.abs(centred).max()), corners, planes)
        if count:
            planes[:count, 3] -= planes[:count, :3] @ middle
            return Triangles(corners[:count], planes[:count])
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    corners = hull.simplices.astype(np.int64)
    first, second, third = (points[corners[:, i]] for i in range(3))
    inward = (np.cross(second - first, third - first) * hull.equations[:, :3]).sum(1) < 0
    corners[inward] = corners[inward][:, ::-1]
    return Triangles(corners, hull.equations)


@allocating
def _wrap(points: F64, size: float, corners: I64, planes: F64) -> int:
    """Write the ``Triangles`` of points (N, 3) around the origin; how many, 0 if unsure.

    ``size`` (m): no coordinate is larger.
    """
    count, fuzz = points.shape[0], FUZZ * size
    hull = room_for_hull(count)
    for n in range(count):
        for x in range(3):
            hull.corners[n, x] = points[n, x]
    start = np.zeros(4, np.int64)
    widest = 0.0
    for x in range(3):
        low = high = 0  # argmin would import SciPy's linear algebra when the kernel is loaded
        for n in range(count):
            if points[n, x] < points[low, x]:
                low = n
            if points[n, x] > points[high, x]:
                high = n
        if points[high, x] - points[low, x] > widest:
            widest = points[high, x] - points[low, x]
            start[0], start[1] = low, high
    # what is farthest from the line of these two, and then from the plane of all three
    c, u, v = points[start[0]], np.empty(3), np.empty(3)
    for corner in range(2, 4):
        best = 0.0
        for n in range(count):
            d = points[n]
            if corner == 2:
                for x in range(3):
                    u[x] = points[start[1], x] - c[x]
                along = 0.0
                for x in range(3):
                    along += (d[x] - c[x]) * u[x]
                along /= u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
                far = 0.0
                for x in range(3):
                    far += (d[x] - c[x] - along * u[x]) ** 2
                far = far**0.5
            else:
                far = 0.0
                for x in range(3):
                    far += (d[x] - c[x]) * v[x]
                far = abs(far)
            if far > best:
                best, start[corner] = far, n
        if best <= FLAT * size:
            return 0
        if corner == 2:
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                e = points[start[2]]
                v[x] = u[y] * (e[z] - c[z]) - u[z] * (e[y] - c[y])
            norm = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) ** 0.5
            for x in range(3):
                v[x] /= norm
    above = 0.0
    for x in range(3):
        above += (points[start[3], x] - c[x]) * v[x]
    if above > 0.0:
        start[0], start[1] = start[1], start[0]
    begin(hull, start)
    used = 4
    for n in range(count):
        for f in range(used):
            if sees(hull, f, n, fuzz):
                used = max(used, grow(hull, f, n, used, fuzz))
                break
    found = 0
    for f in range(used):
        if hull.height[f] < np.inf:
            for n in range(count):
                if sees(hull, f, n, OUTSIDE * size):
                    return 0
            for x in range(3):
                corners[found, x] = hull.face[f, x]
                planes[found, x] = hull.normal[f, x]
            planes[found, 3] = -hull.height[f]
            found += 1
    return found
