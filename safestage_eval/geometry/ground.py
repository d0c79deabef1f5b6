"""The surface that a body stands on: upward faces of any bodies that meet, and where it ends."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from .mover import Mover
from .polygon import COINCIDENT, Outlines, hulls
from .pose import matrix, transform
from .shape import BodyShape

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

CONTACT_TOLERANCE = 2e-3
"""m. Bodies in contact overlap or part a little; faces this close in height are one surface."""

GAP = 5e-3
"""m. Faces no further apart make one surface; a wall no further off guards an edge."""

SEAM = 1e-5
"""m. Faces that overlap or part by less than this just meet."""

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
        polygon: (F,) their outlines.
        plane: (F, 3) its height is plane[0] + plane[1] x + plane[2] y, m.
        endless: (F,) it has no edge: a plane.
    """

    polygon: Outlines
    plane: F64
    endless: Bool


class Solids(NamedTuple):
    """What P geoms are made of, in the world.

    Attributes:
        points: (V, 3) m.
        edges: (E, 2) which points each joins, and of which geom it is, (E,) ``part``; of convex ones.
        triangles: (N, 3) of those that are not convex.
    """

    points: F64
    edges: I64
    part: I64
    triangles: I64


class Edges(NamedTuple):
    """E edges of faces, from a corner to the next, the face to the left.

    Attributes:
        start, along: (E, 2) m, and a unit vector.
        length: (E,) m.
        face: (E,) whose it is.
        level, rise: (E,) m at the start, and how much higher it is a metre further along.
    """

    start: F64
    along: F64
    length: F64
    face: I64
    level: F64
    rise: F64

    def strips(self, near: float, far: float) -> Outlines:
        """(E,) rectangles along the edges, from ``near`` to ``far`` (m) outside."""
        out = np.stack([self.along[:, 1], -self.along[:, 0]], 1)
        ends = self.start, self.start + self.length[:, None] * self.along
        corners = [ends[i] + u * out for i, u in ((0, near), (1, near), (1, far), (0, far))]
        return np.asarray(shapely.polygons(np.stack(corners, 1)))


class Spans(NamedTuple):
    """Where faces lie along edges.

    Attributes:
        edge, face: (N,).
        begin, end: (N,) m along the edge.
    """

    edge: I64
    face: I64
    begin: F64
    end: F64


class Surface(NamedTuple):
    """Faces that can be reached from a standing place without a step down, and where they end.

    Attributes:
        polygon, plane: (K,), (K, 3) its faces.
        edges: (S, 2, 2) m, its boundary: from, to, the inside to the left.
        edge_plane: (S, 3) that of the face that each edge belongs to.
    """

    polygon: Outlines
    plane: F64
    edges: F64
    edge_plane: F64


def ground_of(movers: Sequence[Mover], frame: int) -> Ground:
    """The upward faces of bodies at a frame."""
    return joined([_faces_at(*_place(mover, frame)) for mover in movers])


def joined(grounds: Sequence[Ground]) -> Ground:
    """Join the faces of several."""
    nothing = Ground(np.empty(0, object), np.empty((0, 3)), np.empty(0, np.bool_))
    columns = zip(nothing, *grounds, strict=True)
    return Ground(*(np.concatenate(column) for column in columns))


def solids_of(movers: Sequence[Mover], frame: int) -> Solids:
    """The geoms of bodies at a frame; planes are left out."""
    found = [_solids_at(*_place(mover, frame)) for mover in movers]
    points = np.cumsum([0, *(len(one.points) for one in found)])
    parts = np.cumsum([0, *(1 + one.part.max(initial=0) for one in found)])
    return Solids(
        np.concatenate([np.empty((0, 3)), *(one.points for one in found)]),
        _concatenated([one.edges + n for one, n in zip(found, points, strict=False)], (0, 2)),
        _concatenated([one.part + n for one, n in zip(found, parts, strict=False)], (0,)),
        _concatenated([one.triangles + n for one, n in zip(found, points, strict=False)], (0, 3)),
    )


def surface_from(ground: Ground, seeds: I64, drop: float) -> Surface:
    """Collect the faces that hang together with the seeds (N,), and their edges.

    A face goes on in another where that begins within ``GAP`` beyond its edge and lies less than
    ``drop`` (m; never less than ``CONTACT_TOLERANCE``) below or above, and is no wall.
    Edges under a higher face of the same surface are none: nothing can stand there.
    """
    drop = max(drop, CONTACT_TOLERANCE)
    tree = shapely.STRtree(ground.polygon)
    reached, todo = np.zeros(len(ground.plane), np.bool_), seeds
    limits = -drop, min(WALL_HEIGHT * (1 - 1e-3), drop)
    found: list[tuple[Edges, Spans]] = []
    while len(todo):
        reached[todo] = True
        edges = _edges_of(ground, todo[~ground.endless[todo]])
        spans = _spans(ground, tree, edges, (SEAM, GAP), limits)
        found.append((edges, spans))
        todo = np.unique(spans.face[~reached[spans.face]])
    edges = Edges(*(np.concatenate(column) for column in zip(*(e for e, _ in found), strict=True)))
    before = np.cumsum([0, *(len(e.length) for e, _ in found)])
    on = Spans(
        *(np.concatenate(column) for column in zip(*(
            s._replace(edge=s.edge + n) for (_, s), n in zip(found, before, strict=False)
        ), strict=True))
    )  # fmt: skip
    under = _spans(ground, tree, edges, (-SEAM, SEAM), (CONTACT_TOLERANCE, drop))
    covering = reached[under.face]
    which, begin, end = _uncovered(
        edges.length,
        np.concatenate([on.edge, under.edge[covering]]),
        np.concatenate([on.begin, under.begin[covering]]),
        np.concatenate([on.end, under.end[covering]]),
    )
    start, along = edges.start[which], edges.along[which]
    free = np.stack([start + begin[:, None] * along, start + end[:, None] * along], 1)
    plane = ground.plane[edges.face[which]]
    return Surface(ground.polygon[reached], ground.plane[reached], free, plane)


def walls(solids: Solids, plane: F64) -> Outlines:
    """(W,) outlines of what geoms have ``WALL_HEIGHT`` above a plane (3,).

    Polygons; where a mesh is cut, which may be a mere sheet, the line of the cut.
    """
    height = WALL_HEIGHT * (1 - 1e-3)
    level = solids.points[:, 2] - plane[0] - solids.points[:, :2] @ plane[1:] - height
    point, edge = cut(solids.points[:, :2], level, solids.edges)
    part, owner = np.unique(solids.part[edge], return_inverse=True)
    found = hulls(point, owner, len(part))
    if not len(solids.triangles):
        return found
    above = level[solids.triangles] > 0
    corners = solids.triangles[above.any(1) & ~above.all(1)]
    sides = np.stack([corners, np.roll(corners, -1, 1)], -1).reshape(-1, 2)
    point, _ = cut(solids.points[:, :2], level, sides)  # two of the three sides of each
    return np.concatenate([found, shapely.linestrings(point.reshape(-1, 2, 2))])


def cut(points: F64, level: F64, edges: I64) -> tuple[F64, I64]:
    """(N, 2) where edges (E, 2) of points (V, 2) pass level 0, and (N,) which edges these are."""
    through = np.flatnonzero((level[edges[:, 0]] <= 0) != (level[edges[:, 1]] <= 0))
    one, other = edges[through].T
    share = level[one] / (level[one] - level[other])
    return points[one] + share[:, None] * (points[other] - points[one]), through


def part_over(polygon: Outlines, gap: F64, low: float, high: float) -> Outlines:
    """(N,) what of convex outlines (N,) has heights gap[0] + gap[1] x + gap[2] y in [low, high].

    Of gaps (N, 3); an empty outline, or None, where nothing has.
    """
    xy, which = shapely.get_coordinates(polygon, return_index=True)
    level = gap[which, 0] + (gap[which, 1:] * xy).sum(1)
    out = polygon.copy()
    beyond = np.unique(which[(level < low) | (level > high)])
    slope = np.sqrt((gap[beyond, 1:] ** 2).sum(1))
    tilted = slope > COINCIDENT
    out[beyond[~tilted]] = None
    beyond, slope = beyond[tilted], slope[tilted]
    if len(beyond):
        first = xy[np.searchsorted(which, beyond)]
        up = gap[beyond, 1:] / slope[:, None]
        aside = 4 * ENDLESS * np.stack([-up[:, 1], up[:, 0]], 1)
        here = gap[beyond, 0] + (gap[beyond, 1:] * first).sum(1)
        a, b = (first + ((end - here) / slope)[:, None] * up for end in (low, high))
        band = shapely.polygons(np.stack([a - aside, b - aside, b + aside, a + aside], 1))
        out[beyond] = shapely.intersection(out[beyond], band)
    return out


def _edges_of(ground: Ground, faces: I64) -> Edges:
    corners, which = shapely.get_coordinates(ground.polygon[faces], return_index=True)
    way = np.diff(corners, axis=0)
    length = np.sqrt((way**2).sum(1))
    keep = np.flatnonzero((which[1:] == which[:-1]) & (length > COINCIDENT))
    start, along, face = corners[keep], way[keep] / length[keep, None], faces[which[keep]]
    plane = ground.plane[face]
    level = plane[:, 0] + (plane[:, 1:] * start).sum(1)
    return Edges(start, along, length[keep], face, level, (plane[:, 1:] * along).sum(1))


def _spans(
    ground: Ground,
    tree: shapely.STRtree,
    edges: Edges,
    reach: tuple[float, float],
    limits: tuple[float, float],
) -> Spans:
    """Where other faces lie in strips along edges.

    ``reach``: how far outside the edge the strips begin and end, m. ``limits``: between which heights
    over the edge.
    """
    strips = edges.strips(*reach)
    e, f = tree.query(strips, predicate="intersects")
    other = edges.face[e] != f
    e, f = e[other], f[other]
    start, along, rise = edges.start[e], edges.along[e], edges.rise[e]
    gap = ground.plane[f].copy()
    gap[:, 0] += rise * (start * along).sum(1) - edges.level[e]
    gap[:, 1:] -= rise[:, None] * along
    corners = shapely.get_coordinates(strips[e]).reshape(-1, 5, 2)
    level = gap[:, :1] + (gap[:, None, 1:] * corners).sum(-1)
    low, high = level.min(1), level.max(1)
    whole = (low >= limits[0]) & (high <= limits[1])
    partly = np.flatnonzero(~whole & (low <= limits[1]) & (high >= limits[0]))
    use = np.concatenate([np.flatnonzero(whole), partly])
    e, f, gap, start, along = e[use], f[use], gap[use], start[use], along[use]
    face = ground.polygon[f]
    if len(partly):
        face[-len(partly) :] = part_over(face[-len(partly) :], gap[-len(partly) :], *limits)
    begin, end = _within(face, start, along, reach)
    begin, end = np.maximum(begin, 0.0), np.minimum(end, edges.length[e])
    wide = end - begin > COINCIDENT
    return Spans(e[wide], f[wide], begin[wide], end[wide])


def _within(face: Outlines, start: F64, along: F64, reach: tuple[float, float]) -> tuple[F64, F64]:
    """(N,) m, from where to where convex outlines lie in endless strips along edges."""
    xy, which = shapely.get_coordinates(face, return_index=True)
    way = xy - start[which]
    s = (way * along[which]).sum(1)
    u = way[:, 0] * along[which, 1] - way[:, 1] * along[which, 0]
    inside = (u >= reach[0]) & (u <= reach[1])
    begin, end = np.full(len(face), np.inf), np.full(len(face), -np.inf)
    ends = [(which[inside], s[inside])]
    for limit in reach:  # where a side passes it
        side = np.flatnonzero((which[1:] == which[:-1]) & ((u[1:] <= limit) != (u[:-1] <= limit)))
        share = (limit - u[side]) / (u[side + 1] - u[side])
        ends.append((which[side], s[side] + share * (s[side + 1] - s[side])))
    for row, at in ends:
        np.minimum.at(begin, row, at)
        np.maximum.at(end, row, at)
    return begin, end


def _uncovered(length: F64, edge: I64, begin: F64, end: F64) -> tuple[I64, F64, F64]:
    """What spans leave of edges of so many m: which edge, from where, to where."""
    every = np.arange(len(length))  # an empty span at either end
    edge = np.concatenate([every, edge, every])
    begin = np.concatenate([np.zeros(len(length)), begin, length])
    end = np.concatenate([np.zeros(len(length)), end, length])
    order = np.lexsort([begin, edge])
    edge, begin, end = edge[order], begin[order], end[order]
    far = length.max(initial=0) + 1  # edge after edge, so that one running maximum does for all
    reached = np.maximum.accumulate(end + far * edge) - far * edge
    free = np.flatnonzero((edge[1:] == edge[:-1]) & (begin[1:] - reached[:-1] > SEAM))
    return edge[free], reached[free], begin[free + 1]


Place = tuple[BodyShape, tuple[float, ...], tuple[float, ...]]


def _place(mover: Mover, frame: int) -> Place:
    """A shape and its pose as a key of a cache."""
    t = frame if len(mover) > 1 else 0
    return mover.shape, tuple(mover.position[t].tolist()), tuple(mover.orientation[t].tolist())


@lru_cache(maxsize=_POSES_KEPT)
def _solids_at(
    shape: BodyShape, position: tuple[float, ...], orientation: tuple[float, ...]
) -> Solids:
    parts = [part for part in shape.polytopes if part is not None]
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    convex = [(part, n) for part, n in zip(parts, first, strict=False) if part.convex]
    points = np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)])
    return Solids(
        transform(position, orientation, points),
        _concatenated([part.edges + n for part, n in convex], (0, 2)),
        np.repeat(np.arange(len(convex)), [len(part.edges) for part, _ in convex]),
        _concatenated(
            [np.array(part.faces) + n for part, n in zip(parts, first, strict=False)
             if not part.convex], (0, 3),
        ),
    )  # fmt: skip


@lru_cache(maxsize=_POSES_KEPT)
def _faces_at(
    shape: BodyShape, position: tuple[float, ...], orientation: tuple[float, ...]
) -> Ground:
    rotation, origin = matrix(np.array(orientation)), np.array(position)
    normal = shape.faces.normal @ rotation.T
    up = np.flatnonzero(normal[:, 2] >= LEVEL)
    corners = [shape.faces.corners[i] @ rotation.T + origin for i in up]
    owner = np.repeat(np.arange(len(up)), [len(face) for face in corners])
    points = np.concatenate([np.empty((0, 3)), *corners])
    outline = hulls(points[:, :2], owner, len(up))
    solid = np.flatnonzero(shapely.area(outline) > 0)
    faces = [Ground(
        outline[solid],
        np.array([_plane(normal[up[i]], corners[i][0]) for i in solid]).reshape(-1, 3),
        np.zeros(len(solid), np.bool_),
    )]  # fmt: skip
    for geom in shape.geoms:
        if geom.kind == "plane":
            ahead = rotation @ matrix(geom.orientation)[:, 2]
            if ahead[2] >= LEVEL:
                point = origin + rotation @ np.array(geom.position)
                square = shapely.box(*(point[:2] - ENDLESS), *(point[:2] + ENDLESS))
                plane = _plane(ahead, point)[None]
                faces.append(Ground(np.array([square]), plane, np.ones(1, np.bool_)))
    return joined(faces)


def _plane(normal: F64, point: F64) -> F64:
    slope = -normal[:2] / normal[2]
    return np.array([point[2] - slope @ point[:2], *slope])


def _concatenated(arrays: Sequence[I64], empty: tuple[int, ...]) -> I64:
    return np.concatenate([np.empty(empty, np.int64), *arrays])
