"""Distance of a standing body from the edge of the surface that it stands on."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from .extent import lowest
from .ground import (
    Ground,
    Surface,
    covers,
    face_of,
    ground_of,
    heights,
    joined,
    section,
    surface_from,
    walls,
    world_vertices,
)  # fmt: skip
from .ground_kernels import CONTACT_TOLERANCE, GAP, SEAM
from .mover import Mover, frame_count
from .polygon import (
    contains,
    convex_hull,
    crosses,
    edges,
    enters,
    grown,
    loops,
    nearest_on,
    overlap,
    union_outline,
)  # fmt: skip
from .polytope import Polytope
from .stillness import still_runs, still_since

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

BASE_HEIGHT = 5e-3
"""m. The base of a body is what it has within this of the surface on which it stands."""

BESIDE, BESIDE_ANGLE = 1e-4, 1e-3
"""m and rad. Where bodies beside the supports are is looked up anew when one has moved by so much."""

PIECE = 2e-3
"""m. Edges near walls are judged piece by piece."""

AT_ONCE = 64
"""Pieces of an edge that are looked at together, the nearest first."""

ALIKE = 2.0
"""deg. Faces that lean no further apart than this are stood on in the same way."""

Walls = Callable[[F64], F64]
"""Outlines (W, 2, 2) of what rises over a plane (3,)."""


def edge_margin(
    a: Mover,
    supports: Sequence[Mover],
    frames: I64 | None = None,
    height: F64 | None = None,
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
        frames: (N,) indices of the frames to measure; all when None. Frames in which nothing has
            moved by 10 µm or 1e-4 rad repeat the value.
        height: (T,) m, world z of the contact; a's lowest point when None.
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
    lifted = np.zeros(total) if height is None else height - np.broadcast_to(lowest(a), total)
    place = still_since(supports, wanted)
    beside = still_since(around, wanted, BESIDE, BESIDE_ANGLE)
    for there, near in np.unique(np.stack([place, beside], 1), axis=0):
        here = wanted[(place == there) & (beside == near)]
        scene = _Scene(supports, around, int(there), int(near), drop)
        for frame, alike in still_runs((a, *supports), here):
            margin[alike] = scene.margin(world_vertices(a, frame), float(lifted[frame]))
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
        self._under = len(under.many)
        self._ground = joined([under, ground_of(around, beside)])
        self._bodies, self._drop = ((supports, frame), (around, beside)), drop
        self._surfaces: dict[bytes, Surface] = {}
        self._walls: dict[tuple[float, ...], F64] = {}

    def margin(self, parts: list[tuple[Polytope, F64]], lifted: float) -> float:
        """Edge margin (m) of a body given by its geoms' corners, as if it were lower by ``lifted`` (m)."""
        if not parts:
            return np.nan
        points = np.concatenate([points for _, points in parts])
        base, seeds = self._base(parts, self._touched(points, lifted), lifted)
        if not len(seeds):
            return np.nan
        if self._ground.endless[seeds].any():
            return np.inf
        faces = [self._ground.polygon(i) for i in seeds]
        margin = self._distance(base, self._surface(self._ground, seeds), seeds)
        if margin <= 0 and _spans(base, faces):
            whole = convex_hull(np.concatenate(faces))
            level = self._ground.plane[seeds].mean(0)
            spanned = joined([self._ground, face_of(whole, level)])
            with_hull = np.append(seeds, len(self._ground.many))
            margin = max(margin, self._distance(base, self._surface(spanned, with_hull), seeds))
        return margin

    def _touched(self, points: F64, lifted: float) -> I64:
        """Faces of the supports in whose plane the lowest of points (V, 3) lies."""
        planes = self._ground.plane[: self._under]
        level = points[:, 2].min() - planes[:, 0]
        for face in np.flatnonzero(planes[:, 1:].any(1)):
            plane = planes[face]
            level[face] = (points[:, 2] - points[:, :2] @ plane[1:]).min() - plane[0]
        return np.flatnonzero(np.abs(level + lifted) <= CONTACT_TOLERANCE)

    def _base(
        self, parts: list[tuple[Polytope, F64]], near: I64, lifted: float
    ) -> tuple[list[F64], I64]:
        """The polygons with which a body stands, and the faces (F,) that it stands on."""
        base: list[F64] = []
        stood: list[int] = []
        for group in self._alike(near):
            plane = self._ground.plane[group[0]]
            level = [p[:, 2] - plane[0] - p[:, :2] @ plane[1:] for _, p in parts]
            top = min(float(one.min()) for one in level) + lifted + BASE_HEIGHT
            cuts = [_below(*part, one, top) for part, one in zip(parts, level, strict=True)]
            feet = [convex_hull(cut) for cut in cuts if len(cut)]
            if feet and _meet(feet, [self._ground.polygon(i) for i in group]):
                base += feet
                stood += group
        return base, np.array(stood, np.int64)

    def _alike(self, faces: I64) -> list[list[int]]:
        """Group faces that lean the same way."""
        groups: list[list[int]] = []
        for face in faces:
            slope = self._ground.plane[face, 1:]
            for group in groups:
                apart = slope - self._ground.plane[group[0], 1:]
                if np.abs(apart).max() <= np.tan(np.deg2rad(ALIKE)):
                    group.append(int(face))
                    break
            else:
                groups.append([int(face)])
        return groups

    def _surface(self, ground: Ground, seeds: I64) -> Surface:
        key = seeds.tobytes()
        if key not in self._surfaces:
            chosen = np.zeros(len(ground.many), np.bool_)
            chosen[seeds] = True
            self._surfaces[key] = surface_from(ground, chosen, self._drop)
        return self._surfaces[key]

    def _walls_over(self, plane: F64) -> F64:
        key = tuple(np.round(plane, 6).tolist())
        if key not in self._walls:
            self._walls[key] = np.concatenate([walls(*at, plane) for at in self._bodies])
        return self._walls[key]

    def _distance(self, base: list[F64], surface: Surface, seeds: I64) -> float:
        corners = np.concatenate(base)
        deepest = heights(self._ground.plane[seeds], corners).min(0)
        floor = deepest - max(self._drop, CONTACT_TOLERANCE)
        beyond = corners[~covers(surface.ground, corners, floor)]
        return _signed_distance(base, beyond, surface, self._walls_over)


def _below(part: Polytope, points: F64, level: F64, height: float) -> F64:
    """(N, 2) corners of the projection of what lies at or under a level: points (V, 3), world."""
    return np.concatenate([points[level <= height, :2], section(part, points, level, height)])


def _meet(base: list[F64], patch: list[F64]) -> bool:
    """Whether some of the base lies over the patch."""
    if contains(patch, np.concatenate(base)).any() or contains(base, np.concatenate(patch)).any():
        return True
    rim, outline = (np.concatenate([edges(part) for part in parts]) for parts in (base, patch))
    return bool(crosses(rim[:, 0], rim[:, 1], outline).any())


def _spans(base: list[F64], patch: list[F64]) -> bool:
    """Whether the base touches the patch at separate places, or all around a gap."""
    shared = [overlap(foot, face) for foot in base for face in patch]
    touched = [grown(part, SEAM) for part in shared if len(part)]
    return loops(union_outline(touched)) > 1


def _signed_distance(base: list[F64], beyond: F64, surface: Surface, over: Walls) -> float:
    """From a base to the unguarded edges of a surface; ``beyond`` (N, 2): corners off the surface."""
    rim = np.concatenate([edges(polygon) for polygon in base])
    corners = np.concatenate(base)
    outline, owner = surface.edges, surface.owner
    if not len(outline):
        return np.inf
    length = np.sqrt(((outline[:, 1] - outline[:, 0]) ** 2).sum(1))
    piece = max(PIECE, float(length.sum()) / 1000)
    guarded = _Guarded(surface.ground.plane, rim, corners, over)
    inside = contains(base, outline.reshape(-1, 2))
    if not (len(beyond) or inside.any() or crosses(outline[:, 0], outline[:, 1], rim).any()):
        return _nearest_free(outline, owner, piece, rim, corners, guarded)
    outline, owner = _pieces(outline, owner, piece)
    free = outline[~guarded(outline, owner)]
    if not len(free):
        return np.inf
    out = -np.inf
    if len(beyond):
        nearest = nearest_on(beyond, outline).distance
        passed = nearest_on(beyond, free).distance <= nearest + SEAM  # not over a wall
        out = nearest[passed].max(initial=-np.inf)
    ends = free.reshape(-1, 2)
    sunk = ends[contains(base, ends)]
    if len(sunk):
        out = max(out, float(nearest_on(sunk, rim).distance.max()))
    if out > -np.inf:
        return -float(out)
    if crosses(free[:, 0], free[:, 1], rim).any():
        return 0.0
    return _apart(free, rim, corners)


def _apart(segments: F64, rim: F64, corners: F64) -> float:
    """Distance (m) of some segments and the rim of a base, which do not cross."""
    to_rim = nearest_on(segments.reshape(-1, 2), rim).distance.min()
    return min(float(to_rim), float(nearest_on(corners, segments).distance.min()))


def _each_apart(segments: F64, rim: F64, corners: F64) -> F64:
    """(S,) as ``_apart``, of each segment."""
    # x and y by themselves: numpy takes ten times as long to add up along an axis of two
    (way_x, way_y), first = (
        (segments[:, 1] - segments[:, 0]).T[..., None],
        segments[:, 0].T[..., None],
    )
    x, y = corners[:, 0] - first[0], corners[:, 1] - first[1]
    square = np.maximum(way_x**2 + way_y**2, 1e-300)
    share = np.clip((x * way_x + y * way_y) / square, 0, 1)
    across = np.sqrt(((x - share * way_x) ** 2 + (y - share * way_y) ** 2).min(1))
    to_rim = nearest_on(segments.reshape(-1, 2), rim).distance.reshape(-1, 2).min(1)
    return np.asarray(np.minimum(to_rim, across))


def _nearest_free(
    outline: F64, owner: I64, piece: float, rim: F64, corners: F64, guarded: _Guarded
) -> float:
    """Metres from a base to the nearest piece of an outline that is free; +inf without any."""
    least = _each_apart(outline, rim, corners)
    nearest = np.inf
    for segment in np.argsort(least, kind="stable"):
        if least[segment] >= nearest:
            break
        pieces, owners = _pieces(outline[[segment]], owner[[segment]], piece)
        near = nearest_on(pieces.mean(1), rim).distance
        order = np.argsort(near, kind="stable")
        for start in range(0, len(order), AT_ONCE):
            some = order[start : start + AT_ONCE]
            if near[some[0]] - piece / 2 >= nearest:
                break
            free = pieces[some][~guarded(pieces[some], owners[some])]
            if len(free):
                nearest = min(nearest, _apart(free, rim, corners))
    return nearest


def _pieces(outline: F64, owner: I64, piece: float) -> tuple[F64, I64]:
    """Cut an outline into pieces no longer than so many m; with the face that each belongs to."""
    share = np.sqrt(((outline[:, 1] - outline[:, 0]) ** 2).sum(1)) / piece
    many = np.maximum(np.ceil(share - 1e-6), 1).astype(np.int64)
    which = np.repeat(np.arange(len(outline)), many)
    rank = np.arange(len(which)) - np.repeat(np.cumsum(many) - many, many)
    start, along = outline[which, 0], outline[which, 1] - outline[which, 0]
    low, high = (rank / many[which])[:, None], ((rank + 1) / many[which])[:, None]
    return np.stack([start + low * along, start + high * along], 1), owner[which]


class _Guarded:
    """Whether a wall stands at a piece of an edge, or between it and the base.

    The way starts a little inside the base, because what touches a wall overlaps it a little, and
    ends a little beyond the edge, because a wall may stand just outside. What the way only leaves is
    no wall: it is what the base stands on, where the surface goes on further down.
    """

    def __init__(self, planes: F64, rim: F64, corners: F64, over: Walls) -> None:
        self._planes, self._over, self._rim = planes, over, rim
        self._middle = _centroid(convex_hull(corners))

    def __call__(self, pieces: F64, owner: I64) -> Bool:
        """(N,) for pieces (N, 2, 2) of the edges of faces (N,)."""
        guarded = np.zeros(len(pieces), np.bool_)
        for face in np.unique(owner):
            outlines = self._over(self._planes[face])
            if len(outlines):
                guarded[owner == face] = self._behind(pieces[owner == face], outlines)
        return guarded

    def _behind(self, pieces: F64, outlines: F64) -> Bool:
        end = pieces.mean(1)
        along = pieces[:, 1] - pieces[:, 0]
        out = np.stack([along[:, 1], -along[:, 0]], 1)
        out /= np.sqrt((out**2).sum(1, keepdims=True))
        start = nearest_on(end, self._rim).foot
        inward = self._middle - start
        norm = np.maximum(np.sqrt((inward**2).sum(1, keepdims=True)), 1e-300)
        start = start + inward / norm * np.minimum(CONTACT_TOLERANCE, norm)
        return enters(start, end, outlines) | enters(end, end + GAP * out, outlines)


def _centroid(polygon: F64) -> F64:
    """(2,) m, of the area of a convex polygon; of a segment or point, its middle."""
    first = polygon[0]
    one, other = polygon[1:-1] - first, polygon[2:] - first
    area = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    if not area.sum() > 0:
        return np.asarray((polygon.min(0) + polygon.max(0)) / 2)
    return np.asarray(first + area @ (one + other) / (3 * area.sum()))
