"""The surface that a body stands on: upward faces of any bodies that meet, and where it ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel

from .arrays import owned
from .mover import Mover
from .polygon import COINCIDENT, bounds, convex_hull, holds_point, insert_span
from .polytope import Polytope
from .pose import matrix, transform
from .shape import BodyShape

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

CONTACT_TOLERANCE = 2e-3
"""m. Bodies in contact overlap or part a little; faces this close in height are one surface."""

GAP = 5e-3
"""m. Faces no further apart make one surface; a wall no further off guards an edge."""

WALL_HEIGHT = 1e-2
"""m. What rises this far above a surface at its edge, or on the way there, guards the edge."""

LEVEL = np.cos(np.deg2rad(30.0))
"""Faces whose normal rises at least this much look up."""

SEAM = 1e-5
"""m. Faces that overlap or part by less than this just meet."""

ENDLESS = 100.0
"""m. How far a plane reaches around its origin; it has no edge."""

_POSES_KEPT = 1024


class Ground(NamedTuple):
    """F upward faces, seen from above, each convex.

    Attributes:
        corners: (C, 2) m, face after face, counter-clockwise.
        first, many: (F,) where a face's corners begin, and how many they are.
        plane: (F, 3) its height is plane[0] + plane[1] x + plane[2] y, m.
        endless: (F,) it has no edge: a plane.
    """

    corners: F64
    first: I64
    many: I64
    plane: F64
    endless: Bool

    def polygon(self, face: int) -> F64:
        """(N, 2) corners of one face."""
        return self.corners[self.first[face] : self.first[face] + self.many[face]]


class Surface(NamedTuple):
    """Faces that can be reached from a standing place without a step down, and where they end.

    Attributes:
        ground: its faces, and the strips between those that only nearly meet.
        edges: (S, 2, 2) m, its boundary: from, to, the inside to the left.
        owner: (S,) the face that each edge belongs to.
    """

    ground: Ground
    edges: F64
    owner: I64


def ground_of(movers: Sequence[Mover], frame: int) -> Ground:
    """The upward faces of bodies at a frame."""
    return joined([_faces_at(*_place(mover, frame)) for mover in movers])


def joined(grounds: Sequence[Ground]) -> Ground:
    """Join the faces of several."""
    corners = [np.empty((0, 2)), *(g.corners for g in grounds)]
    before = np.cumsum([len(part) for part in corners])
    first = [g.first + start for g, start in zip(grounds, before, strict=False)]
    return Ground(
        owned(np.concatenate(corners)),
        np.concatenate([np.empty(0, np.int64), *first]),
        np.concatenate([np.empty(0, np.int64), *(g.many for g in grounds)]),
        owned(np.concatenate([np.empty((0, 3)), *(g.plane for g in grounds)])),
        np.concatenate([np.empty(0, np.bool_), *(g.endless for g in grounds)]),
    )


def face_of(polygon: F64, plane: F64) -> Ground:
    """Make a ground of one face: polygon (N, 2) m, counter-clockwise, plane (3,)."""
    return Ground(
        owned(polygon),
        np.zeros(1, np.int64),
        np.array([len(polygon)]),
        owned(plane).reshape(1, 3),
        np.zeros(1, np.bool_),
    )


def surface_from(ground: Ground, seeds: Bool, drop: float) -> Surface:
    """Collect the faces that hang together with the seeds (F,), and their edges.

    A face goes on in another where that begins within ``GAP`` beyond its edge and lies less than
    ``drop`` (m; never less than ``CONTACT_TOLERANCE``) below or above, and is no wall.
    Edges under a higher face of the same surface are none: nothing can stand there.
    """
    drop = max(drop, CONTACT_TOLERANCE)
    faces = len(ground.many)
    box = np.empty((faces, 4))
    bounds(ground.corners, ground.first, ground.many, box)
    reached = seeds.copy()
    room, span = np.empty((2, int(ground.many.max(initial=1)) + 8, 3)), np.empty(3)
    limits = np.array([-drop, min(WALL_HEIGHT * (1 - 1e-3), drop)])
    _flood(*ground, box, limits, reached, np.empty(faces, np.int64), room, span)
    kept = np.flatnonzero(reached)
    chosen = _chosen(ground, kept)
    size = int(chosen.many.sum()) * (len(kept) + 1) + 1
    edges, owner = np.empty((size, 4)), np.empty(size, np.int64)
    strips, beside = np.empty((size, 4, 2)), np.empty(size, np.int64)
    covered = np.empty((2 * len(kept) + 1, 2))
    many, between = _border(
        *chosen, owned(box[kept]), limits, room, span, covered, edges, owner, strips, beside
    )
    bridges = Ground(
        owned(strips[:between].reshape(-1, 2)),
        np.arange(0, 4 * between, 4),
        np.full(between, 4),
        owned(chosen.plane[beside[:between]]),
        np.zeros(between, np.bool_),
    )
    return Surface(joined([chosen, bridges]), edges[:many].reshape(-1, 2, 2), owner[:many])


def covers(ground: Ground, points: F64, floor: F64) -> Bool:
    """(N,) whether a face lies under points (N, 2), at no less than a height (N,) m."""
    under = np.zeros(len(points), np.bool_)
    _covers(*ground, owned(points), owned(floor), under)
    return under


def heights(planes: F64, points: F64) -> F64:
    """(P, N) m, the height of planes (P, 3) at points (N, 2)."""
    return np.asarray(planes[:, :1] + planes[:, 1:] @ points.T)


def walls(movers: Sequence[Mover], frame: int, plane: F64) -> F64:
    """(W, 2, 2) outlines of what bodies have ``WALL_HEIGHT`` above a plane (3,).

    The inside is to the left; where a mesh is cut, which may be a mere sheet, on both sides.
    """
    outlines = [np.empty((0, 2, 2))]
    height = WALL_HEIGHT * (1 - 1e-3)
    for mover in movers:
        for part, points in _vertices_at(*_place(mover, frame)):
            level = points[:, 2] - plane[0] - points[:, :2] @ plane[1:]
            if level.min() <= height < level.max():
                outlines.append(_outline(part, points, level, height))
    return np.concatenate(outlines)


def world_vertices(mover: Mover, frame: int) -> list[tuple[Polytope, F64]]:
    """Each geom's polytope with its vertices (V, 3) m, world, at a frame; planes are left out."""
    t = frame if len(mover) > 1 else 0
    position, orientation = mover.position[t], mover.orientation[t]
    return [
        (part, transform(position, orientation, part.vertices))
        for part in mover.shape.polytopes
        if part is not None
    ]


def section(part: Polytope, points: F64, level: F64, height: float) -> F64:
    """(N, 2) m where a polytope's edges pass a level: points (V, 3) m, world, their levels (V,)."""
    one, other = part.edges[:, 0], part.edges[:, 1]
    through = (level[one] <= height) != (level[other] <= height)
    one, other = one[through], other[through]
    share = (height - level[one]) / (level[other] - level[one])
    a, b = points[one, :2], points[other, :2]
    return np.asarray(a + share[:, None] * (b - a))


def _outline(part: Polytope, points: F64, level: F64, height: float) -> F64:
    if part.convex:
        cut = convex_hull(section(part, points, level, height))
        return np.asarray(np.stack([cut, np.roll(cut, -1, 0)], 1))
    faces = np.array(part.faces)
    above = level[faces] > height
    faces = faces[above.any(1) & ~above.all(1)]
    above = level[faces] > height
    over = above != np.roll(above, -1, 1)  # two of the three sides of each triangle
    one, other = faces[over], np.roll(faces, -1, 1)[over]
    share = (height - level[one]) / (level[other] - level[one])
    cut = points[one, :2] + share[:, None] * (points[other, :2] - points[one, :2])
    cut = cut.reshape(-1, 2, 2)
    return np.concatenate([cut, cut[:, ::-1]])


Place = tuple[BodyShape, tuple[float, ...], tuple[float, ...]]


def _place(mover: Mover, frame: int) -> Place:
    """A shape and its pose as a key of a cache."""
    t = frame if len(mover) > 1 else 0
    return mover.shape, tuple(mover.position[t].tolist()), tuple(mover.orientation[t].tolist())


@lru_cache(maxsize=_POSES_KEPT)
def _vertices_at(
    shape: BodyShape, position: tuple[float, ...], orientation: tuple[float, ...]
) -> list[tuple[Polytope, F64]]:
    return world_vertices(Mover.build(shape, position, orientation), 0)


@lru_cache(maxsize=_POSES_KEPT)
def _faces_at(
    shape: BodyShape, position: tuple[float, ...], orientation: tuple[float, ...]
) -> Ground:
    rotation, origin = matrix(np.array(orientation)), np.array(position)
    faces = shape.faces
    normal = faces.normal @ rotation.T
    grounds = []
    for i in np.flatnonzero(normal[:, 2] >= LEVEL):
        corners = faces.corners[i] @ rotation.T + origin
        hull = convex_hull(corners[:, :2])
        if len(hull) >= 3:
            grounds.append(face_of(hull, _plane(normal[i], corners[0])))
    for geom in shape.geoms:
        if geom.kind == "plane":
            up = rotation @ matrix(geom.orientation)[:, 2]
            if up[2] >= LEVEL:
                point = origin + rotation @ np.array(geom.position)
                square = point[:2] + ENDLESS * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
                face = face_of(square, _plane(up, point))
                grounds.append(face._replace(endless=np.ones(1, np.bool_)))
    return joined(grounds)


def _plane(normal: F64, point: F64) -> F64:
    slope = -normal[:2] / normal[2]
    return np.array([point[2] - slope @ point[:2], *slope])


def _chosen(ground: Ground, faces: I64) -> Ground:
    count = ground.many[faces]
    rows = np.concatenate(
        [np.arange(ground.first[i], ground.first[i] + ground.many[i]) for i in faces]
        or [np.empty(0, np.int64)]
    )
    return Ground(
        owned(ground.corners[rows]),
        np.cumsum(count) - count,
        count,
        owned(ground.plane[faces]),
        ground.endless[faces],
    )


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
def _flood(
    corners: F64, first: I64, count: I64, plane: F64, endless: Bool, box: F64, limits: F64,
    reached: Bool, todo: I64, room: F64, span: F64,
) -> None:  # fmt: skip
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
def _border(
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
def _covers(
    corners: F64, first: I64, count: I64, plane: F64, endless: Bool, points: F64, floor: F64,  # noqa: ARG001
    under: Bool,
) -> None:  # fmt: skip
    for p in range(points.shape[0]):
        x, y = points[p, 0], points[p, 1]
        for i in range(first.shape[0]):
            if plane[i, 0] + plane[i, 1] * x + plane[i, 2] * y < floor[p]:
                continue
            if holds_point(corners, first[i], count[i], x, y):
                under[p] = True
                break
