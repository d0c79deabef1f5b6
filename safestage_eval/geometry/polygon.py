"""Convex polygons in the horizontal plane, and the outline and area of their union.

A polygon is an (N, 2) array of corners in metres, counter-clockwise; N may be 1 or 2 for a point
or a segment. A union is a list of polygons.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel

from .arrays import owned

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

COINCIDENT = 1e-9
"""m. Edges closer than this lie on each other."""


def convex_hull(points: F64) -> F64:
    """(M, 2) corners of the convex hull of points (N, 2), counter-clockwise. Andrew 1979."""
    if len(points) == 0:
        return points
    ordered = owned(points[np.lexsort((points[:, 1], points[:, 0]))])
    out = np.empty((2 * len(points), 2))
    return out[: chain(ordered, out)]


def union_outline(polygons: list[F64]) -> F64:
    """(S, 2, 2) segments (from, to) of the union's boundary, the inside to the left.

    Each polygon's edges without what lies in the others; where edges lie on each other, one of
    them if both have the inside on the same side, none if on opposite sides.
    """
    solid = [polygon for polygon in polygons if len(polygon) >= 3]
    if not solid:
        return np.empty((0, 2, 2))
    count = np.array([len(polygon) for polygon in solid], np.int64)
    corners = owned(np.concatenate(solid))
    first = np.cumsum(count) - count
    box = np.empty((len(solid), 4))
    bounds(corners, first, count, box)
    out = np.empty((int(count.sum()) * (len(solid) + 1), 4))
    length = _outline(corners, first, count, box, np.zeros((len(solid), 4)), out)
    return out[:length].reshape(-1, 2, 2)


def union_area(polygons: list[F64]) -> float:
    """m², by Green's theorem over the outline."""
    a, b = np.moveaxis(union_outline(polygons), 1, 0)
    return float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2)


def grown(polygon: F64, by: float) -> F64:
    """(N, 2) the polygon with every edge moved outward by so many metres; N ≥ 3.

    Corners sharper than 30° are moved by four times as much only, not as far as the edges meet.
    """
    normal = outward(polygon)
    before = np.roll(normal, 1, 0)
    # the corner between two edges moves by u with u·n = by for both normals
    bisector = normal + before
    return np.asarray(
        polygon + by * 2 * bisector / np.maximum((bisector**2).sum(1, keepdims=True), 0.25)
    )


def outward(polygon: F64) -> F64:
    """(N, 2) unit normals of the edges, edge i from corner i to the next."""
    edge = np.roll(polygon, -1, 0) - polygon
    return np.asarray(
        np.stack([edge[:, 1], -edge[:, 0]], 1) / np.sqrt((edge**2).sum(1, keepdims=True))
    )


def contains(polygons: list[F64], points: F64) -> Bool:
    """(N,) whether points (N, 2) lie in the union, its boundary included."""
    inside = np.zeros(len(points), bool)
    for polygon in polygons:
        if len(polygon) >= 3:
            _contains(owned(polygon), owned(points), inside)
    return inside


def clip(subject: F64, window: F64, slack: float = 0.0) -> F64:
    """(N, 2) the part of a convex polygon, segment or point in a window of at least three corners.

    Sutherland & Hodgman 1974. Corners less than ``slack`` (m) outside count as inside; corners may
    occur twice.
    """
    part = subject
    for normal, corner in zip(outward(window), window, strict=True):
        beyond = (part - corner) @ normal
        out = beyond > slack
        if out.any():
            following, later = np.roll(part, -1, 0), np.roll(beyond, -1)
            cut = out != np.roll(out, -1)
            share = beyond[cut] / (beyond[cut] - later[cut])
            corners = part[cut] + share[:, None] * (following[cut] - part[cut])
            order = np.argsort(np.concatenate([np.flatnonzero(~out), np.flatnonzero(cut) + 0.5]))
            part = np.concatenate([part[~out], corners])[order]
    return part


def overlap(first: F64, second: F64) -> F64:
    """(N, 2) corners of what two polygons share, N = 0 if it has no area.

    Both have at least three corners; with fewer there is no area.
    """
    if len(first) < 3 or len(second) < 3:
        return np.empty((0, 2))
    part = clip(first, second)
    if len(part) < 3:
        return np.empty((0, 2))
    hull = convex_hull(part)
    return hull if len(hull) >= 3 and union_area([hull]) > COINCIDENT**2 else np.empty((0, 2))


def loops(outline: F64) -> int:
    """How many closed lines an outline (S, 2, 2) consists of: outer boundaries and holes.

    Ends that are no further apart than a nanometre are the same.
    """
    ends = outline.reshape(-1, 2)
    group = np.arange(len(outline))
    apart = np.abs(ends[:, None] - ends[None]).max(-1)
    for i, j in np.argwhere(apart <= 2 * COINCIDENT) // 2:
        one, other = group[i], group[j]
        if one != other:
            group[group == max(one, other)] = min(one, other)
    return len(np.unique(group))


def edges(polygon: F64) -> F64:
    """(N, 2, 2) its edges as segments; a point is one segment of no length."""
    return np.asarray(np.stack([polygon, np.roll(polygon, -1, 0)], 1))


class Nearest(NamedTuple):
    """The nearest of some segments to each of N points: how far (N,) m, where (N, 2), which (N,)."""

    distance: F64
    foot: F64
    segment: I64


def nearest_on(points: F64, segments: F64) -> Nearest:
    """Find the nearest of segments (S, 2, 2), S ≥ 1, to points (N, 2)."""
    nearest = Nearest(
        np.full(len(points), np.inf), np.empty((len(points), 2)), np.zeros(len(points), np.int64)
    )
    _nearest(owned(points), owned(segments), *nearest)
    return nearest


def crosses(starts: F64, ends: F64, segments: F64) -> Bool:
    """(N,) whether the way from start (N, 2) to end (N, 2) meets any of segments (S, 2, 2)."""
    met = np.zeros(len(starts), bool)
    _crosses(owned(starts), owned(ends), owned(segments), False, met)
    return met


def enters(starts: F64, ends: F64, outline: F64) -> Bool:
    """(N,) as ``crosses``, from the right of a segment to its left: into what an outline encloses."""
    met = np.zeros(len(starts), bool)
    _crosses(owned(starts), owned(ends), owned(outline), True, met)
    return met


@kernel
def sort_points(points: F64, n: int) -> None:
    """Sort the first n points by x, then by y, in place. Heapsort, Williams 1964."""
    for k in range(n // 2 - 1, -1, -1):
        _sift(points, k, n)
    for end in range(n - 1, 0, -1):
        for i in range(2):
            points[0, i], points[end, i] = points[end, i], points[0, i]
        _sift(points, 0, end)


@kernel
def _sift(points: F64, root: int, n: int) -> None:
    x, y = points[root, 0], points[root, 1]
    while 2 * root + 1 < n:
        child = 2 * root + 1
        if child + 1 < n and (
            points[child, 0] < points[child + 1, 0]
            or (
                points[child, 0] == points[child + 1, 0] and points[child, 1] < points[child + 1, 1]
            )
        ):
            child += 1
        if points[child, 0] < x or (points[child, 0] == x and points[child, 1] <= y):
            break
        points[root, 0], points[root, 1] = points[child, 0], points[child, 1]
        root = child
    points[root, 0], points[root, 1] = x, y


@kernel
def chain(points: F64, out: F64) -> int:
    """Write the lower, then the upper hull of points (N, 2) ordered by x, then y; returns the corners written."""
    n, m = points.shape[0], 0
    for sweep in range(2):
        base = m
        for step in range(n):
            i = step if sweep == 0 else n - 1 - step
            x, y = points[i, 0], points[i, 1]
            while m >= base + 2:
                ax, ay = out[m - 2, 0], out[m - 2, 1]
                turn = (out[m - 1, 0] - ax) * (y - ay) - (out[m - 1, 1] - ay) * (x - ax)
                if turn > 0.0:
                    break
                m -= 1
            if m == base or x != out[m - 1, 0] or y != out[m - 1, 1]:
                out[m, 0], out[m, 1] = x, y
                m += 1
        m -= 1  # the last point of each half is the first of the other
    return max(m, 1)


@kernel
def bounds(corners: F64, first: I64, count: I64, box: F64) -> None:
    """Write low x, low y, high x, high y of each polygon into ``box`` (P, 4).

    Polygon i has ``count[i]`` of the corners (C, 2), from ``first[i]`` on.
    """
    for i in range(first.shape[0]):
        for k in range(count[i]):
            for axis in range(2):
                c = corners[first[i] + k, axis]
                box[i, axis] = c if k == 0 else min(box[i, axis], c)
                box[i, 2 + axis] = c if k == 0 else max(box[i, 2 + axis], c)


@kernel
def insert_span(spans: F64, count: int, low: float, high: float) -> None:
    """Add a span to ``count`` spans (S, 2) that are ordered by where they begin."""
    at = count
    while at > 0 and spans[at - 1, 0] > low:
        spans[at, 0], spans[at, 1] = spans[at - 1, 0], spans[at - 1, 1]
        at -= 1
    spans[at, 0], spans[at, 1] = low, high


@kernel
def covers(
    corners: F64, first: I64, count: I64, box: F64, i: int, ax: float, ay: float, dx: float,
    dy: float, covered: F64,
) -> int:  # fmt: skip
    """Find where the other polygons cover the edge from (ax, ay) by (dx, dy) of polygon i.

    Writes from where to where, as shares of the edge, into the first columns of ``covered`` (P, 4), in
    the order in which they begin; returns how many. Its other columns remember of each polygon, from one
    edge to the next, which of its sides had the edge outside, and which polygon covered the whole edge:
    of many polygons that lie on each other the right ones are asked first.
    """
    spans, many = 0, first.shape[0]
    low_x, high_x = min(ax, ax + dx) - COINCIDENT, max(ax, ax + dx) + COINCIDENT
    low_y, high_y = min(ay, ay + dy) - COINCIDENT, max(ay, ay + dy) + COINCIDENT
    latest = int(covered[i, 3])
    for step in range(many):
        j = (latest + step) % many
        if j == i or box[j, 0] > high_x or box[j, 2] < low_x:
            continue
        if box[j, 1] > high_y or box[j, 3] < low_y:
            continue
        low, high = 0.0, 1.0
        k = int(covered[j, 2])
        for _ in range(count[j]):
            k = k + 1 if k + 1 < count[j] else 0
            bx, by = corners[first[j] + k, 0], corners[first[j] + k, 1]
            after = first[j] + (k + 1) % count[j]
            ex, ey = corners[after, 0] - bx, corners[after, 1] - by
            edge = np.sqrt(ex * ex + ey * ey)
            if edge <= COINCIDENT:
                continue
            nx, ny = ey / edge, -ex / edge
            start = (ax - bx) * nx + (ay - by) * ny
            slope = dx * nx + dy * ny
            if abs(start) <= COINCIDENT and abs(start + slope) <= COINCIDENT:
                if dx * ex + dy * ey > 0.0 and j > i:
                    high = -1.0  # on each other, same side: this one stays
            elif slope == 0.0:
                if start > 0.0:
                    high = -1.0
            elif slope > 0.0:
                high = min(high, -start / slope)
            else:
                low = max(low, -start / slope)
            if high <= low:
                covered[j, 2] = k - 1  # the side that is asked first next time
                break
        if low == 0.0 and high == 1.0:
            covered[i, 3] = j
            covered[0, 0], covered[0, 1] = 0.0, 1.0
            return 1
        if high > low:
            insert_span(covered, spans, low, high)
            spans += 1
    return spans


@kernel
def _outline(corners: F64, first: I64, count: I64, box: F64, covered: F64, out: F64) -> int:
    written = 0
    for i in range(first.shape[0]):
        for c in range(count[i]):
            ax, ay = corners[first[i] + c, 0], corners[first[i] + c, 1]
            following = first[i] + (c + 1) % count[i]
            dx, dy = corners[following, 0] - ax, corners[following, 1] - ay
            length = np.sqrt(dx * dx + dy * dy)
            if length <= COINCIDENT:
                continue
            spans = covers(corners, first, count, box, i, ax, ay, dx, dy, covered)
            reached = 0.0
            for c2 in range(spans + 1):
                stop = covered[c2, 0] if c2 < spans else 1.0
                if (stop - reached) * length > COINCIDENT:
                    out[written, 0], out[written, 1] = ax + reached * dx, ay + reached * dy
                    out[written, 2], out[written, 3] = ax + stop * dx, ay + stop * dy
                    written += 1
                if c2 < spans:
                    reached = max(reached, covered[c2, 1])
    return written


@kernel
def holds_point(corners: F64, first: int, count: int, x: float, y: float) -> bool:
    """Whether a point lies in the polygon of ``count`` corners from ``first`` on, or on its boundary."""
    for k in range(count):
        a, b = first + k, first + (k + 1) % count
        dx, dy = corners[b, 0] - corners[a, 0], corners[b, 1] - corners[a, 1]
        beyond = (x - corners[a, 0]) * dy - (y - corners[a, 1]) * dx
        if beyond > COINCIDENT * math.sqrt(dx * dx + dy * dy):
            return False
    return True


@kernel
def _contains(polygon: F64, points: F64, inside: Bool) -> None:
    for i in range(points.shape[0]):
        if not inside[i]:
            inside[i] = holds_point(polygon, 0, polygon.shape[0], points[i, 0], points[i, 1])


@kernel
def _nearest(points: F64, segments: F64, distance: F64, foot: F64, segment: I64) -> None:
    for j in range(segments.shape[0]):
        ax, ay = segments[j, 0, 0], segments[j, 0, 1]
        dx, dy = segments[j, 1, 0] - ax, segments[j, 1, 1] - ay
        square = dx * dx + dy * dy
        for i in range(points.shape[0]):
            x, y = points[i, 0] - ax, points[i, 1] - ay
            share = 0.0
            if square > 0.0:
                share = min(max((x * dx + y * dy) / square, 0.0), 1.0)
            ex, ey = x - share * dx, y - share * dy
            d = ex * ex + ey * ey
            if d < distance[i]:
                distance[i] = d
                segment[i] = j
                foot[i, 0], foot[i, 1] = ax + share * dx, ay + share * dy
    for i in range(points.shape[0]):
        distance[i] = np.sqrt(distance[i])


@kernel
def _crosses(starts: F64, ends: F64, segments: F64, inward: bool, met: Bool) -> None:
    for i in range(starts.shape[0]):
        dx, dy = ends[i, 0] - starts[i, 0], ends[i, 1] - starts[i, 1]
        for j in range(segments.shape[0]):
            ex = segments[j, 1, 0] - segments[j, 0, 0]
            ey = segments[j, 1, 1] - segments[j, 0, 1]
            gx, gy = segments[j, 0, 0] - starts[i, 0], segments[j, 0, 1] - starts[i, 1]
            turn = dx * ey - dy * ex
            if turn == 0.0 or (inward and turn > 0.0):
                continue
            along, across = (gx * ey - gy * ex) / turn, (gx * dy - gy * dx) / turn
            if 0.0 <= along <= 1.0 and 0.0 <= across <= 1.0:
                met[i] = True
                break
