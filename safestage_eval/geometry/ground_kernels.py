"""Kernels of upward faces seen from above: which of them make one surface, and where it ends.

The first arguments are the fields of ``ground.Ground``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel

from .polygon import COINCIDENT, holds_point, insert_span

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

CONTACT_TOLERANCE = 2e-3
"""m. Bodies in contact overlap or part a little; faces this close in height are one surface."""

GAP = 5e-3
"""m. Faces no further apart make one surface; a wall no further off guards an edge."""

SEAM = 1e-5
"""m. Faces that overlap or part by less than this just meet."""


@kernel
def _clip(points: F64, n: int, axis: int, bound: float, upward: bool, out: F64) -> int:
    """Write the part of a polygon (n, 3) whose coordinate is at least, or at most, a bound."""
    written = 0
    for k in range(n):
        after = (k + 1) % n
        here = points[k, axis] - bound if upward else bound - points[k, axis]
        there = points[after, axis] - bound if upward else bound - points[after, axis]
        if here >= 0.0:
            for c in range(3):
                out[written, c] = points[k, c]
            written += 1
        if (here >= 0.0) != (there >= 0.0):
            share = here / (here - there)
            for c in range(3):
                out[written, c] = points[k, c] + share * (points[after, c] - points[k, c])
            written += 1
    return written


@kernel
def _meets(
    corners: F64, first: I64, count: I64, plane: F64, i: int, k: int, j: int, near: float,
    far: float, low: float, high: float, room: F64, span: F64,
) -> bool:  # fmt: skip
    """Whether face j lies in a strip along edge k of face i, and where.

    ``near``, ``far``: how far outside the edge the strip begins and ends, m. ``low``, ``high``:
    between which heights over the edge. Writes from where to where along the edge, and how far outside j
    begins, all in m, into ``span``.
    """
    n = count[i]
    ax, ay = corners[first[i] + k, 0], corners[first[i] + k, 1]
    after = first[i] + (k + 1) % n
    dx, dy = corners[after, 0] - ax, corners[after, 1] - ay
    length = math.sqrt(dx * dx + dy * dy)
    if length <= COINCIDENT:
        return False
    dx, dy = dx / length, dy / length
    m = count[j]
    start = plane[i, 0] + plane[i, 1] * ax + plane[i, 2] * ay
    rise = plane[i, 1] * dx + plane[i, 2] * dy
    for c in range(m):
        x, y = corners[first[j] + c, 0], corners[first[j] + c, 1]
        s = (x - ax) * dx + (y - ay) * dy
        room[0, c, 0] = s
        room[0, c, 1] = (x - ax) * dy - (y - ay) * dx
        room[0, c, 2] = plane[j, 0] + plane[j, 1] * x + plane[j, 2] * y - start - rise * s
    m = _clip(room[0], m, 0, 0.0, True, room[1])
    m = _clip(room[1], m, 0, length, False, room[0])
    m = _clip(room[0], m, 1, near, True, room[1])
    m = _clip(room[1], m, 1, far, False, room[0])
    m = _clip(room[0], m, 2, low, True, room[1])
    m = _clip(room[1], m, 2, high, False, room[0])
    if m == 0:
        return False
    span[0], span[1], span[2] = np.inf, -np.inf, np.inf
    for c in range(m):
        span[0] = min(span[0], room[0, c, 0])
        span[1] = max(span[1], room[0, c, 0])
        span[2] = min(span[2], room[0, c, 1])
    return bool(span[1] - span[0] > COINCIDENT)


@kernel
def _apart(box: F64, i: int, j: int) -> bool:
    return bool(
        box[i, 0] > box[j, 2] + GAP
        or box[j, 0] > box[i, 2] + GAP
        or box[i, 1] > box[j, 3] + GAP
        or box[j, 1] > box[i, 3] + GAP
    )


@kernel
def flood(
    corners: F64, first: I64, count: I64, plane: F64, endless: Bool, box: F64, limits: F64,
    reached: Bool, todo: I64, room: F64, span: F64,
) -> None:  # fmt: skip
    """Mark the faces that hang together with those that are marked."""
    faces, waiting = first.shape[0], 0
    for i in range(faces):
        if reached[i]:
            todo[waiting] = i
            waiting += 1
    while waiting:
        waiting -= 1
        i = todo[waiting]
        if endless[i]:
            continue
        for j in range(faces):
            if reached[j] or _apart(box, i, j):
                continue
            for k in range(count[i]):
                if _meets(
                    corners, first, count, plane, i, k, j, SEAM, GAP, limits[0], limits[1], room,
                    span,
                ):  # fmt: skip
                    reached[j] = True
                    todo[waiting] = j
                    waiting += 1
                    break


@kernel
def border(
    corners: F64, first: I64, count: I64, plane: F64, endless: Bool, box: F64, limits: F64,
    room: F64, span: F64, covered: F64, edges: F64, owner: I64, strips: F64, beside: I64,
) -> tuple[int, int]:  # fmt: skip
    """Write the edges of faces without what goes on, and the strips between faces that go on."""
    faces, written, between = first.shape[0], 0, 0
    for i in range(faces):
        for k in range(0 if endless[i] else count[i]):
            ax, ay = corners[first[i] + k, 0], corners[first[i] + k, 1]
            after = first[i] + (k + 1) % count[i]
            dx, dy = corners[after, 0] - ax, corners[after, 1] - ay
            length = math.sqrt(dx * dx + dy * dy)
            if length <= COINCIDENT:
                continue
            dx, dy = dx / length, dy / length
            spans = 0
            for j in range(faces):
                if j == i or _apart(box, i, j):
                    continue
                for buried in range(2):
                    if not _meets(
                        corners, first, count, plane, i, k, j, -SEAM if buried else SEAM,
                        SEAM if buried else GAP,
                        CONTACT_TOLERANCE if buried else limits[0],
                        -limits[0] if buried else limits[1], room, span,
                    ):  # fmt: skip
                        continue
                    if not buried:
                        for c in range(4):
                            s = span[0] if c % 3 == 0 else span[1]
                            u = span[2] + SEAM if c < 2 else -SEAM
                            strips[between, c, 0] = ax + s * dx + u * dy
                            strips[between, c, 1] = ay + s * dy - u * dx
                        beside[between] = i
                        between += 1
                    insert_span(covered, spans, span[0], span[1])
                    spans += 1
            so_far = 0.0
            for c in range(spans + 1):
                stop = covered[c, 0] if c < spans else length
                if stop - so_far > SEAM:
                    edges[written, 0], edges[written, 1] = ax + so_far * dx, ay + so_far * dy
                    edges[written, 2], edges[written, 3] = ax + stop * dx, ay + stop * dy
                    owner[written] = i
                    written += 1
                if c < spans:
                    so_far = max(so_far, covered[c, 1])
    return written, between


@kernel
def cover(
    corners: F64, first: I64, count: I64, plane: F64, endless: Bool, points: F64, floor: F64,  # noqa: ARG001
    under: Bool,
) -> None:  # fmt: skip
    """Mark points (N, 2) that a face lies under, at no less than a height (N,) m."""
    for p in range(points.shape[0]):
        x, y = points[p, 0], points[p, 1]
        for i in range(first.shape[0]):
            if plane[i, 0] + plane[i, 1] * x + plane[i, 2] * y < floor[p]:
                continue
            if holds_point(corners, first[i], count[i], x, y):
                under[p] = True
                break
