"""Where two sides that face each other overlap: corners of the patch, at many frames in one call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, helper, kernel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CORNERS = 12
"""Points that stand for a round outline: the patch is 3 % smaller at most."""
STRAIGHT = 1e-12
"""m²: twice the area of three points that lie on one line."""
THIN = 1e-9
"""m: half the width that an edge or a point is given, to be an outline."""


class _Outlines(NamedTuple):
    """Room to work in.

    Attributes:
        first, second: (R, 2) m, the outlines of the two sides in the plane between them.
        points, hull: (R, 2) m, a side on its way to becoming an outline.
        heights: (R,) m, of points above an edge.
    """

    first: F64
    second: F64
    points: F64
    hull: F64
    heights: F64


def overlap(first: F64, second: F64, normal: F64, play: F64, room: float) -> tuple[F64, I64]:
    """(P, 3) m, corners of where the two sides overlap, by frame; (F,) how many there are.

    Args:
        first: (F, V, 3) m, corners of a convex solid, or (1, V, 3) if it stays; V = 0 of a plane,
            which is everywhere.
        second: the same of another.
        normal: (F, 3) unit, from the first to the second.
        play: (F, 2) m, how far behind the foremost a corner of either still counts.
        room: m, by which the second's outline is widened.
    """
    most = max(first.shape[1], second.shape[1], 4 * CORNERS) + 4
    out, many = np.empty((len(normal), most, 3)), np.zeros(len(normal), np.int64)
    _overlap_all(first, second, normal, play, room, out, many)
    return out[np.arange(most) < many[:, None]], many


@allocating
def _overlap_all(
    first: F64, second: F64, normal: F64, play: F64, room: float, out: F64, many: I64
) -> None:
    most = out.shape[1]
    outlines = _Outlines(
        np.empty((most, 2)),
        np.empty((most, 2)),
        np.empty((most, 2)),
        np.empty((2 * most, 2)),
        np.empty(most),
    )
    axes = np.empty((3, 3))
    for f in range(len(normal)):
        _span(normal[f], axes)
        level, sides, n = 0.0, 0, 0
        if first.shape[1]:
            corners = first[min(f, len(first) - 1)]
            count, height = _side(corners, 1.0, axes, play[f, 0], outlines.points)
            n, level, sides = _hull(outlines, count, outlines.first), level + height, sides + 1
        if second.shape[1]:
            corners = second[min(f, len(second) - 1)]
            count, height = _side(corners, -1.0, axes, play[f, 1], outlines.points)
            level, sides = level + height, sides + 1
            if sides == 2:
                m = _fewer(outlines.second, _hull(outlines, count, outlines.second))
                n = _clip(outlines, _fewer(outlines.first, n), m, room)
            else:
                n = _hull(outlines, count, outlines.first)
        many[f] = n
        for k in range(n):
            x, y = outlines.first[k, 0], outlines.first[k, 1]
            for i in range(3):
                out[f, k, i] = x * axes[0, i] + y * axes[1, i] + level / sides * axes[2, i]


@helper
def _span(normal: F64, axes: F64) -> None:
    """Two axes across the normal, and the normal."""
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    nx, ny, nz = normal[0], normal[1], normal[2]
    if x <= y and x <= z:
        ux, uy, uz = 0.0, nz, -ny
    elif y <= z:
        ux, uy, uz = -nz, 0.0, nx
    else:
        ux, uy, uz = ny, -nx, 0.0
    size = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / size, uy / size, uz / size
    axes[0, 0], axes[0, 1], axes[0, 2] = ux, uy, uz
    axes[1, 0], axes[1, 1], axes[1, 2] = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    axes[2, 0], axes[2, 1], axes[2, 2] = nx, ny, nz


@kernel
def _side(corners: F64, sign: float, axes: F64, play: float, out: F64) -> tuple[int, float]:
    """The foremost corners along ± the normal, in the plane across it: how many, mean height (m)."""
    top = -np.inf
    for c in range(len(corners)):
        top = max(top, sign * _dot(corners[c], axes[2]))
    count, total = 0, 0.0
    for c in range(len(corners)):
        height = _dot(corners[c], axes[2])
        if sign * height >= top - play:
            out[count, 0], out[count, 1] = _dot(corners[c], axes[0]), _dot(corners[c], axes[1])
            total += height
            count += 1
    return count, total / count


@helper
def _dot(a: F64, b: F64) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def _hull(outlines: _Outlines, count: int, out: F64) -> int:
    """Convex hull of the first points, counter-clockwise; Andrew's monotone chain."""
    points, hull = outlines.points, outlines.hull
    for k in range(1, count):
        x, y = points[k, 0], points[k, 1]
        j = k - 1
        while j >= 0 and (points[j, 0] > x or (points[j, 0] == x and points[j, 1] > y)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = x, y
    if count == 1:
        out[0, 0], out[0, 1] = points[0, 0], points[0, 1]
        return 1
    found = 0
    for way in range(2):
        n = 0
        for step in range(count):
            p = points[count - 1 - step] if way else points[step]
            while n > 1 and _turn(hull[n - 2], hull[n - 1], p) <= STRAIGHT:
                n -= 1
            hull[n, 0], hull[n, 1] = p[0], p[1]
            n += 1
        for k in range(n - 1):
            out[found, 0], out[found, 1] = hull[k, 0], hull[k, 1]
            found += 1
    return found


@helper
def _turn(a: F64, b: F64, c: F64) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


@kernel
def _fewer(outline: F64, count: int) -> int:
    """Leave at most ``CORNERS`` of the corners: enough to stand on."""
    if count <= CORNERS:
        return count
    for k in range(CORNERS):
        j = k * count // CORNERS
        outline[k, 0], outline[k, 1] = outline[j, 0], outline[j, 1]
    return CORNERS


@kernel
def _clip(outlines: _Outlines, count: int, sides: int, room: float) -> int:
    """Leave what of the first outline, edge or point lies in the second, widened by ``room``.

    Sutherland & Hodgman 1974.
    """
    points, window, kept, heights = outlines.first, outlines.second, outlines.hull, outlines.heights
    if sides < 3:
        _thicken(window, sides)
        sides = 4
    for k in range(sides):
        ax, ay = window[k, 0], window[k, 1]
        ex, ey = window[(k + 1) % sides, 0] - ax, window[(k + 1) % sides, 1] - ay
        size = math.hypot(ex, ey)
        if size < STRAIGHT:
            continue
        for j in range(count):
            x, y = points[j, 0] - ax, points[j, 1] - ay
            heights[j] = (y * ex - x * ey) / size + room
        n = 0
        for j in range(count):
            i = (j + 1) % count
            h, other = heights[j], heights[i]
            if h >= 0 and n < len(heights):
                kept[n, 0], kept[n, 1] = points[j, 0], points[j, 1]
                n += 1
            if (h >= 0) != (other >= 0) and n < len(heights):
                share = h / (h - other)
                for a in range(2):
                    kept[n, a] = points[j, a] + (points[i, a] - points[j, a]) * share
                n += 1
        for j in range(n):
            points[j, 0], points[j, 1] = kept[j, 0], kept[j, 1]
        count = n
        if count == 0:
            break
    return count


@kernel
def _thicken(window: F64, count: int) -> None:
    """Make an edge or a point a narrow rectangle."""
    ax, ay = window[0, 0], window[0, 1]
    bx, by = window[count - 1, 0], window[count - 1, 1]
    size = math.hypot(bx - ax, by - ay)
    x, y = ((bx - ax) / size, (by - ay) / size) if size > 0 else (1.0, 0.0)
    x, y = THIN * x, THIN * y
    window[0, 0], window[0, 1] = ax + y - x, ay - x - y
    window[1, 0], window[1, 1] = bx + y + x, by - x + y
    window[2, 0], window[2, 1] = bx - y + x, by + x + y
    window[3, 0], window[3, 1] = ax - y - x, ay + x - y
