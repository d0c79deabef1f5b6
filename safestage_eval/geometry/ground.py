"""The surface that a body stands on: upward faces of any bodies that meet, and where it ends."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arrays import owned
from .ground_kernels import CONTACT_TOLERANCE, border, cover, flood
from .mover import Mover
from .polygon import bounds, convex_hull
from .polytope import Polytope
from .pose import matrix, transform
from .shape import BodyShape

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

WALL_HEIGHT = 1e-2
"""m. What rises this far above a surface at its edge, or on the way there, guards the edge."""

LEVEL = np.cos(np.deg2rad(30.0))
"""Faces whose normal rises at least this much look up."""

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
    flood(*ground, box, limits, reached, np.empty(faces, np.int64), room, span)
    kept = np.flatnonzero(reached)
    chosen = _chosen(ground, kept)
    size = int(chosen.many.sum()) * (len(kept) + 1) + 1
    edges, owner = np.empty((size, 4)), np.empty(size, np.int64)
    strips, beside = np.empty((size, 4, 2)), np.empty(size, np.int64)
    covered = np.empty((2 * len(kept) + 1, 2))
    many, between = border(
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
    cover(*ground, owned(points), owned(floor), under)
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
