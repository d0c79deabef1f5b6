"""Distance of a standing body from the edge of the surface that it stands on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from .ground import (
    CONTACT_TOLERANCE,
    ENDLESS,
    GAP,
    SEAM,
    Ground,
    Solids,
    Surface,
    cut,
    ground_of,
    joined,
    part_over,
    solids_of,
    surface_from,
    walls,
)  # fmt: skip
from .mover import Mover, frame_count, placed
from .polygon import Outlines, hulls
from .stillness import first_alike

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

BASE_HEIGHT = 1e-3
"""m. The base of a body is what it has within this of the surface on which it stands: as much as touches."""

BESIDE = 2e-4
"""m. Where bodies beside the supports are is looked up anew when a point of one has moved by so much."""

PIECE = 2e-3
"""m. Edges near walls are judged piece by piece."""

AT_ONCE = 8
"""Pieces of an edge that are looked at together, the nearest first."""

ALIKE = np.tan(np.deg2rad(2.0))
"""Faces whose slopes differ by less than this are stood on in the same way."""

ROUNDED = 1e-4
"""m, and slope. Walls over planes that differ by less are the same."""


def edge_margin(
    a: Mover,
    supports: Sequence[Mover],
    frames: I64 | None = None,
    around: Sequence[Mover] = (),
    drop: float = CONTACT_TOLERANCE,
) -> F64:
    """Signed distance (m) from a's base to the nearest unguarded edge of the surface it stands on.

    The base is the projection of a's geometry within ``BASE_HEIGHT`` of the surface: a wide rim
    further up does not count. The surface begins with the upward faces of the supports at the
    height of contact and goes on, over faces of any body, wherever the next one begins within
    ``GAP`` and lies less than ``drop`` below: what is left where it ends are its edges. An edge is
    guarded when some body rises by ``WALL_HEIGHT`` above the surface at it, or on the straight way
    to it from the base: a bin's walls guard what stands in the bin, not what stands on their top.
    What touches its supports at separate places, or all around a gap, spans it (a board on two
    piers, a lid on a pot): then the convex hull of their faces belongs to the surface. Round geoms
    are right to 0.1 mm; a base that is a nonconvex mesh counts with its convex hull.

    Args:
        a: what stands.
        supports: what it stands on: one body or several that form a surface together.
        frames: (N,) indices of the frames to measure; all when None. Frames in which everything is
            where it was in another, to within 0.05 mm, have that one's value.
        around: other bodies, whose faces may go on from the supports' and whose walls guard.
        drop: m; a step down by less is no edge. Less than 2 mm counts as 2 mm.

    Returns:
        (T,) > 0: entirely on the surface; < 0: minus how far it sticks out; +inf: every edge is
        guarded, or there is none. NaN: no upward face under it or nothing of a at that height, or
        not asked for.
    """
    total = frame_count(a, *supports, *around)
    wanted = np.arange(total) if frames is None else frames
    total = max(total, int(wanted.max(initial=-1)) + 1)  # nothing moves, yet later frames are meant
    margin = np.full(total, np.nan)
    if all(part is None for part in a.shape.polytopes):
        return margin
    place = [
        first_alike(supports, wanted),
        first_alike(around, wanted, BESIDE),
        first_alike((a, *supports), wanted),
    ]
    (there, beside, poses), which = np.unique(place, axis=1, return_inverse=True)
    value = np.empty(len(poses))
    for at, by in np.unique(np.stack([there, beside]), axis=1).T.tolist():
        here = (there == at) & (beside == by)
        value[here] = _Scene(supports, around, at, by, drop).margins(a, poses[here])
    margin[wanted] = value[which]
    return margin


class _Scene:
    """All bodies but the one that stands: its supports at a frame, and the rest at one near it."""

    def __init__(
        self,
        supports: Sequence[Mover],
        around: Sequence[Mover],
        frame: int,
        beside: int,
        drop: float,
    ) -> None:
        under = ground_of(supports, frame)
        self._under = under.plane
        self._ground = joined([under, ground_of(around, beside)])
        self._drop = max(drop, CONTACT_TOLERANCE)
        self._walls = _Walls(solids_of(supports, frame), solids_of(around, beside))

    def margins(self, a: Mover, frames: I64) -> F64:
        """(P,) m, the margins of a body at some frames."""
        body, margin = _Body(a, frames), np.full(len(frames), np.nan)
        base, stood = self._bases(body, len(frames))
        seeds, which = np.unique(stood, axis=0, return_inverse=True)
        for row, chosen in enumerate(seeds):
            if chosen.any():
                margin[which == row] = self._on(base[which == row], np.flatnonzero(chosen))
        return margin

    def _bases(self, body: _Body, many: int) -> tuple[Outlines, Bool]:
        """(P,) outlines with which a body stands, and (P, F) on which faces it does."""
        base, stood = np.full(many, None), np.zeros((many, len(self._ground.plane)), np.bool_)
        level = np.array([body.lowest(plane) for plane in self._under]).reshape(-1, many)
        near, which = np.unique(np.abs(level) <= CONTACT_TOLERANCE, axis=1, return_inverse=True)
        for row, touched in enumerate(near.T):
            poses, faces = np.flatnonzero(which == row), np.flatnonzero(touched)
            while len(faces):
                slope = self._under[faces, 1:]
                same = np.abs(slope - slope[0]).max(1) <= ALIKE
                group, faces = faces[same], faces[~same]
                feet = body.feet(poses, self._under[group[0]])
                met = shapely.intersects(feet, shapely.union_all(self._ground.polygon[group]))
                on = poses[met]
                base[on] = shapely.union_all(np.stack([base[on], feet[met]], 1), axis=1)
                stood[np.ix_(on, group)] = True
        return base, stood

    def _on(self, base: Outlines, seeds: I64) -> F64:
        """(P,) m, the margins of bases (P,) that stand on some faces."""
        ground, planes = self._ground, self._ground.plane[seeds]
        faces = ground.polygon[seeds]
        if ground.endless[seeds].any():
            return np.full(len(base), np.inf)
        surface = surface_from(ground, seeds, self._drop)
        margin = _Edge(surface, base, self._walls).margins(planes, self._drop)
        out = np.flatnonzero(margin <= 0)
        out = out[[_spans(base[p], faces) for p in out]]
        if len(out):
            hull = shapely.orient_polygons(shapely.convex_hull(shapely.union_all(faces)))
            whole = Ground(np.array([hull]), planes.mean(0)[None], np.zeros(1, np.bool_))
            more = joined([ground, whole]), np.append(seeds, len(ground.plane))
            edge = _Edge(surface_from(*more, self._drop), base[out], self._walls)
            margin[out] = np.maximum(margin[out], edge.margins(planes, self._drop))
        return margin


def _spans(base: shapely.Geometry, faces: Outlines) -> bool:
    """Whether a base touches faces at separate places, or all around a gap."""
    shared = shapely.intersection(base, faces)
    touched = shapely.union_all(shared[shapely.area(shared) > 0])
    parts = shapely.get_parts(shapely.buffer(touched, SEAM, join_style="mitre"))
    return bool(len(parts) + shapely.get_num_interior_rings(parts).sum() > 1)


class _Body:
    """The corners of a body at some poses."""

    def __init__(self, a: Mover, frames: I64) -> None:
        parts = [part for part in a.shape.polytopes if part is not None]
        first = np.cumsum([0, *(len(part.vertices) for part in parts)])
        self._edges = np.concatenate([p.edges + n for p, n in zip(parts, first, strict=False)])
        self._part = np.repeat(np.arange(len(parts)), np.diff(first))
        self._many = len(parts)
        self._points = placed(a, frames, np.concatenate([part.vertices for part in parts]))

    def lowest(self, plane: F64) -> F64:
        """(P,) m, of the lowest corner over a plane (3,)."""
        return np.asarray(self._over(self._points, plane).min(1))

    def feet(self, poses: I64, plane: F64) -> Outlines:
        """(N,) what each pose has within ``BASE_HEIGHT`` of its lowest corner over a plane, from above."""
        points, many, n = self._points[poses], self._many, len(poses)
        level = self._over(points, plane)
        level -= level.min(1, keepdims=True) + BASE_HEIGHT
        pose, corner = np.nonzero(level <= 0)
        edges = (self._edges + level.shape[1] * np.arange(n)[:, None, None]).reshape(-1, 2)
        cuts, edge = cut(points[..., :2].reshape(-1, 2), level.ravel(), edges)
        part = self._part[self._edges[edge % len(self._edges), 0]]
        owner = [pose * many + self._part[corner], edge // len(self._edges) * many + part]
        flat = np.concatenate([points[pose, corner, :2], cuts])
        found = hulls(flat, np.concatenate(owner), n * many).reshape(n, many)
        solid = shapely.get_dimensions(found) == 2
        found[solid.any(1)[:, None] & ~solid] = None
        return np.asarray(shapely.union_all(found, axis=1))

    @staticmethod
    def _over(points: F64, plane: F64) -> F64:
        level = points[..., 2] - plane[0]
        return np.asarray(level - points[..., :2] @ plane[1:] if plane[1:].any() else level)


class _Walls:
    """What rises over planes, and what it stands before."""

    def __init__(self, *solids: Solids) -> None:
        self._solids = solids
        self._over: dict[tuple[float, ...], shapely.STRtree] = {}
        self._yards: dict[tuple[float, ...], Outlines] = {}

    def over(self, plane: tuple[float, ...]) -> shapely.STRtree:
        """What rises by ``WALL_HEIGHT`` over a plane."""
        if plane not in self._over:
            found = [walls(one, np.array(plane)) for one in self._solids]
            self._over[plane] = shapely.STRtree(np.concatenate(found))
        return self._over[plane]

    def yards(self, plane: tuple[float, ...]) -> Outlines:
        """(Y,) what walls over a plane enclose on all sides, and a little of the walls."""
        if plane not in self._yards:
            solid = shapely.union_all(shapely.buffer(self.over(plane).geometries, SEAM))
            rings, part = shapely.get_rings(shapely.get_parts(solid), return_index=True)
            inner = shapely.polygons(rings[1:][part[1:] == part[:-1]])
            self._yards[plane] = shapely.buffer(inner, CONTACT_TOLERANCE / 2)
        return self._yards[plane]

    def enter(self, starts: F64, ends: F64, plane: tuple[float, ...]) -> Bool:
        """(N,) whether the way from start (N, 2) to end (N, 2) goes into what rises over a plane.

        What the way only leaves is no wall: it is what the base stands on, where the surface goes on
        further down.
        """
        tree, met = self.over(plane), np.zeros(len(starts), np.bool_)
        if len(tree) and len(starts):
            way, wall = tree.query(shapely.linestrings(np.stack([starts, ends], 1)), "intersects")
            within = shapely.intersects_xy(tree.geometries[wall], *starts[way].T)
            met[way[~within]] = True
        return met


class _Edge:
    """The edge of a surface, cut into pieces, and the bases (P,) that stand on it."""

    def __init__(self, surface: Surface, base: Outlines, over: _Walls) -> None:
        self._surface, self._walls, self._base = surface, over, base
        self._hull = shapely.convex_hull(base)
        self._core = shapely.get_coordinates(shapely.centroid(self._hull))
        solid = shapely.get_dimensions(base) == 2
        self._rim = np.where(solid, shapely.boundary(base), base)
        self._whole = shapely.multilinestrings(shapely.linestrings(surface.edges))
        shapely.prepare(self._whole)
        pieces, which = _pieces(surface.edges, max(PIECE, shapely.length(self._whole) / 1000))
        along = pieces[:, 1] - pieces[:, 0]
        self._half = np.sqrt((along**2).sum(1)) / 2
        self._out = np.stack([along[:, 1], -along[:, 0]], 1) / (2 * self._half[:, None])
        self._middle, self._piece = pieces.mean(1), shapely.linestrings(pieces)
        self._point = shapely.points(self._middle)
        rounded = np.round(surface.edge_plane / ROUNDED) * ROUNDED
        planes, plane = np.unique(rounded, axis=0, return_inverse=True)
        self._planes, self._plane = [tuple(one) for one in planes.tolist()], plane[which]

    def margins(self, planes: F64, drop: float) -> F64:
        """(P,) m; ``planes`` (N, 3) are those of the faces that the bases stand on."""
        if not len(self._piece):
            return np.full(len(self._base), np.inf)
        cover = self._cover(planes, drop)
        margin = np.full(len(self._base), np.nan)
        meets = shapely.intersects(self._whole, self._base)
        for p in np.flatnonzero(meets | ~shapely.covers(cover, self._base)).tolist():
            margin[p] = self._sticks_out(p, cover)
        rest = np.flatnonzero(np.isnan(margin))
        margin[rest] = self._nearest_free(rest)
        return margin

    def _cover(self, planes: F64, drop: float) -> shapely.Geometry:
        """What near the bases lies no deeper under the faces stood on than a step that is no edge."""
        around = shapely.box(*shapely.total_bounds(self._base))
        near = shapely.intersects(self._surface.polygon, around)
        polygon, found = self._surface.polygon[near], []
        for plane in planes:
            gap = self._surface.plane[near] - plane
            gap[:, 0] += drop
            found.append(part_over(polygon, gap, 0.0, ENDLESS))
        whole = shapely.union_all(np.concatenate(found))
        for by in (GAP / 2, -GAP / 2):  # closes the gaps
            whole = shapely.buffer(whole, by, join_style="mitre")
        shapely.prepare(whole)
        return whole

    def _enters(self, piece: I64, starts: F64, ends: F64) -> Bool:
        """(N,) whether ways enter what rises over the faces that pieces (N,) belong to."""
        met = np.zeros(len(piece), np.bool_)
        for plane in np.unique(self._plane[piece]):
            here = self._plane[piece] == plane
            met[here] = self._walls.enter(starts[here], ends[here], self._planes[plane])
        return met

    def _guarded(self, pose: I64, piece: I64) -> Bool:
        """(N,) whether a wall stands between bases (N,) and pieces (N,), or just beyond these.

        The way starts a little inside the base, because what touches a wall overlaps it a little.
        """
        way = shapely.shortest_line(self._rim[pose], self._point[piece])
        start, end = np.moveaxis(shapely.get_coordinates(way).reshape(-1, 2, 2), 1, 0)
        inward = self._core[pose] - start
        norm = np.maximum(np.hypot(*inward.T), 1e-300)[:, None]
        start = start + inward / norm * np.minimum(CONTACT_TOLERANCE, norm)
        beyond = end + GAP * self._out[piece]
        return self._enters(piece, start, end) | self._enters(piece, end, beyond)

    def _sticks_out(self, p: int, cover: shapely.Geometry) -> float:
        """Minus how far a base sticks out (m): 0 where it just meets a free piece, NaN if it meets none."""
        base = self._base[p]
        corners = shapely.points(np.unique(shapely.get_coordinates(base), axis=0))
        corners = corners[~shapely.dwithin(corners, cover, SEAM)]
        nearest = shapely.distance(corners, self._whole)
        far = nearest.max(initial=0) + SEAM
        some = np.flatnonzero(shapely.dwithin(self._piece, base, far))
        free = self._piece[some[~self._guarded(np.full(len(some), p), some)]]
        if not len(free):
            return np.nan
        passed = shapely.distance(corners, shapely.multilinestrings(free)) <= nearest + SEAM
        ends = shapely.points(shapely.get_coordinates(free))
        sunk = ends[shapely.intersects(base, ends)]
        out = [*nearest[passed], *shapely.distance(sunk, self._rim[p])]  # not over a wall
        if out:
            return -float(max(out))
        return 0.0 if shapely.intersects(free, base).any() else np.nan

    def _nearest_free(self, poses: I64) -> F64:
        """(N,) m, from bases to the nearest piece that is free; +inf without any."""
        best = np.full(len(poses), np.inf)
        box = shapely.bounds(self._base[poses]).reshape(-1, 2, 2)
        radius = np.hypot(*(box[:, 1] - box[:, 0]).T) / 2
        way = self._middle - box.mean(1)[:, None]
        least = np.hypot(way[..., 0], way[..., 1]) - radius[:, None] - self._half
        order, start, many = np.argsort(least, axis=1), 0, AT_ONCE
        while start < len(self._piece):
            some = order[:, start : start + many]
            row, column = np.nonzero(np.take_along_axis(least, some, 1) < best[:, None])
            piece = some[row, column]
            apart = shapely.distance(self._base[poses[row]], self._piece[piece])
            near = np.flatnonzero(apart < best[row])
            near = near[~self._guarded(poses[row[near]], piece[near])]
            np.minimum.at(best, row[near], apart[near])
            if start == 0:
                for n in np.flatnonzero(np.isinf(best)):
                    least[n, self._shut_off(self._hull[poses[n]])] = np.inf
            start, many = start + many, 4 * many
        return best

    def _shut_off(self, hull: shapely.Geometry) -> Bool:
        """(K,) pieces that lie outside a yard in which a base stands."""
        off = np.zeros(len(self._piece), np.bool_)
        x, y = self._middle.T
        for plane, key in enumerate(self._planes):
            yards = self._walls.yards(key)
            for yard in yards[shapely.covers(yards, hull)]:
                off |= (self._plane == plane) & ~shapely.intersects_xy(yard, x, y)
        return off


def _pieces(outline: F64, piece: float) -> tuple[F64, I64]:
    """Cut an outline into pieces no longer than so many m; with the edge that each is of."""
    share = np.sqrt(((outline[:, 1] - outline[:, 0]) ** 2).sum(1)) / piece
    many = np.maximum(np.ceil(share - 1e-6), 1).astype(np.int64)
    which = np.repeat(np.arange(len(outline)), many)
    rank = np.arange(len(which)) - np.repeat(np.cumsum(many) - many, many)
    start, along = outline[which, 0], outline[which, 1] - outline[which, 0]
    low, high = (rank / many[which])[:, None], ((rank + 1) / many[which])[:, None]
    return np.stack([start + low * along, start + high * along], 1), which
