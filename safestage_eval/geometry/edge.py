"""How far what stands on a surface is from falling off it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .extent import lowest
from .mover import Mover, frame_count
from .polygon import (
    contains,
    convex_hull,
    crosses,
    edges,
    grown,
    loops,
    nearest_on,
    overlap,
    union_outline,
)  # fmt: skip
from .polytope import Polytope
from .pose import matrix, transform
from .stillness import still_runs

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

BASE_HEIGHT = 5e-3
"""m. The base of a body is what it has within this of the height at which it stands."""

CONTACT_TOLERANCE = 2e-3
"""m. Bodies in contact overlap or part a little; faces this close to where a stands carry it."""

WALL_HEIGHT = 1e-2
"""m. What rises this far over the patch at its edge, or on the way there, guards the edge."""

WALL_GAP = 5e-3
"""m. A wall may stand this far outside the edge that it guards."""

LEVEL = np.cos(np.deg2rad(30.0))
"""Faces whose normal rises at least this much look up."""

SEAM = 1e-5
"""m. Faces are widened by this before they are joined: abutting boxes make one patch."""

PIECE = 2e-3
"""m. Edges near walls are judged piece by piece."""


def edge_margin(
    a: Mover, supports: Sequence[Mover], frames: I64 | None = None, height: F64 | None = None
) -> F64:
    """Signed distance (m) from a's base to the unguarded edge of the patch it stands on.

    The base is the projection of a's geometry within ``BASE_HEIGHT`` of the contact height: a wide
    rim further up does not count. The patch is the union of the supports' upward faces at that
    height, several geoms and bodies merged. An edge is guarded when the supports rise by
    ``WALL_HEIGHT`` at it, or on the straight way to it from the base: a bin's walls guard what
    stands in the bin, not what stands on their top. What touches the patch at separate places, or
    all around a gap, spans it (a board on two piers, a lid on a pot): then the patch counts with
    its convex hull. Round geoms are right to 0.1 mm; a base that
    is a nonconvex mesh counts with its convex hull.

    Args:
        a: what stands.
        supports: what it stands on: one body or several that form a surface together.
        frames: (N,) indices of the frames to measure; all when None. Frames in which nothing has
            moved by 10 µm or 1e-4 rad repeat the value.
        height: (T,) m, world z of the contact; a's lowest point when None.

    Returns:
        (T,) > 0: entirely on the patch; < 0: minus how far it sticks out; +inf: every edge is
        guarded, or it stands on a plane. NaN: no upward face under it or nothing of a at that
        height, or not asked for.
    """
    total = frame_count(a, *supports)
    wanted = np.arange(total) if frames is None else frames
    total = max(total, int(wanted.max(initial=-1)) + 1)  # nothing moves, yet later frames are meant
    margin = np.full(total, np.nan)
    contact = np.broadcast_to(lowest(a) if height is None else height, total)
    for frame, alike in still_runs((a, *supports), wanted):
        margin[alike] = _margin_at(a, supports, frame, float(contact[frame]))
    return margin


def _margin_at(a: Mover, supports: Sequence[Mover], frame: int, height: float) -> float:
    parts = _world_vertices(a, frame)
    if not parts:
        return np.nan
    feet = np.concatenate([points for _, points in parts])
    foot = feet[feet[:, 2].argmin()]
    if any(_plane_carries(support, frame, foot, height) for support in supports):
        return np.inf
    patch = _patch(supports, frame, foot[:2], height)
    if patch is None:
        return np.nan
    cuts = [_below(part, points, height + BASE_HEIGHT) for part, points in parts]
    base = [convex_hull(cut) for cut in cuts if len(cut)]
    if not base:
        return np.nan
    if not _meet(base, patch.polygons):
        return np.nan
    walls = _walls(supports, frame, patch.height + WALL_HEIGHT * (1 - 1e-3))
    margin = _signed_distance(base, patch.polygons, walls)
    if margin <= 0 and _spans(base, patch.polygons):
        whole = convex_hull(np.concatenate(patch.polygons))
        margin = max(margin, _signed_distance(base, [whole], walls))
    return margin


def _world_vertices(mover: Mover, frame: int) -> list[tuple[Polytope, F64]]:
    """Each geom's polytope with its vertices (V, 3) m, world, at a frame; planes are left out."""
    t = frame if len(mover) > 1 else 0
    position, orientation = mover.position[t], mover.orientation[t]
    return [
        (part, transform(position, orientation, part.vertices))
        for part in mover.shape.polytopes
        if part is not None
    ]


def _below(part: Polytope, points: F64, height: float) -> F64:
    """(N, 2) corners of the projection of what lies at or under a height: points (V, 3), world."""
    under = points[:, 2] <= height
    return np.concatenate([points[under, :2], _section(part, points, height)])


def _section(part: Polytope, points: F64, height: float) -> F64:
    """(N, 2) m where a polytope's edges pass through a horizontal plane; points (V, 3), world."""
    a, b = points[part.edges[:, 0]], points[part.edges[:, 1]]
    through = (a[:, 2] <= height) != (b[:, 2] <= height)
    a, b = a[through], b[through]
    share = (height - a[:, 2]) / (b[:, 2] - a[:, 2])
    return np.asarray(a[:, :2] + share[:, None] * (b[:, :2] - a[:, :2]))


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


class _Patch(NamedTuple):
    polygons: list[F64]
    height: float


def _pose(mover: Mover, frame: int) -> tuple[F64, F64]:
    t = frame if len(mover) > 1 else 0
    return matrix(mover.orientation[t]), mover.position[t].astype(np.float64)


def _plane_carries(support: Mover, frame: int, foot: F64, height: float) -> bool:
    for geom in support.shape.geoms:
        if geom.kind == "plane":
            rotation, position = _pose(support, frame)
            normal = rotation @ matrix(geom.orientation)[:, 2]
            point = position + rotation @ np.array(geom.position)
            if normal[2] >= LEVEL:
                level = point[2] - normal[:2] @ (foot[:2] - point[:2]) / normal[2]
                if abs(level - height) <= CONTACT_TOLERANCE:
                    return True
    return False


def _patch(supports: Sequence[Mover], frame: int, foot: F64, height: float) -> _Patch | None:
    """The upward faces whose planes pass the foot (2,) at the contact height; None without any."""
    polygons, levels = [], []
    for support in supports:
        rotation, position = _pose(support, frame)
        faces = support.shape.faces
        normal = faces.normal @ rotation.T
        anchor = faces.anchor @ rotation.T + position
        up = np.flatnonzero(normal[:, 2] >= LEVEL)
        lean = (normal[up, :2] * (foot - anchor[up, :2])).sum(1) / normal[up, 2]
        level = anchor[up, 2] - lean
        near = np.abs(level - height) <= CONTACT_TOLERANCE
        for face in up[near]:
            corners = faces.corners[face] @ rotation.T + position
            polygons.append(grown(convex_hull(corners[:, :2]), SEAM))
        levels += level[near].tolist()
    return _Patch(polygons, max(levels)) if polygons else None


def _walls(supports: Sequence[Mover], frame: int, height: float) -> F64:
    """(W, 2, 2) outlines of what the supports have at the height of a guarding wall's top."""
    found = [np.empty((0, 2, 2))]
    for support in supports:
        rotation, position = _pose(support, frame)
        for part in support.shape.polytopes:
            if part is None:
                continue
            level = part.vertices @ rotation[2] + position[2]
            if not level.min() <= height < level.max():
                continue
            points = part.vertices @ rotation.T + position
            if part.convex:
                cut = _section(part, points, height)
                if len(cut):
                    found.append(edges(convex_hull(cut)))
                continue
            for face in part.faces:
                corners = points[face]
                above = corners[:, 2] > height
                if above.any() and not above.all():
                    after, over = np.roll(corners, -1, 0), above != np.roll(above, -1)
                    share = (height - corners[over, 2]) / (after[over, 2] - corners[over, 2])
                    way = after[over, :2] - corners[over, :2]
                    found.append((corners[over, :2] + share[:, None] * way)[None])
    return np.concatenate(found)


def _signed_distance(base: list[F64], patch: list[F64], walls: F64) -> float:
    outline = union_outline(patch)
    rim = np.concatenate([edges(polygon) for polygon in base])
    corners = np.concatenate(base)
    middle = (corners.min(0) + corners.max(0)) / 2
    if len(walls):
        outline = _pieces(outline)
        guarded = _guarded(outline, rim, middle, walls)
    else:
        guarded = np.zeros(len(outline), bool)
    beyond = corners[~contains(patch, corners)]
    out = -np.inf
    if len(beyond):
        nearest = nearest_on(beyond, outline)
        out = nearest.distance[~guarded[nearest.segment]].max(initial=-np.inf)
    free = outline[~guarded]
    if not len(free):
        return np.inf
    ends = free.reshape(-1, 2)
    inside = contains(base, ends)
    if inside.any():
        out = max(out, float(nearest_on(ends[inside], rim).distance.max()))
    if out > -np.inf:
        return -float(out) - SEAM
    if crosses(rim[:, 0], rim[:, 1], free).any():
        return 0.0
    apart = min(nearest_on(ends, rim).distance.min(), nearest_on(corners, free).distance.min())
    return float(apart) - SEAM


def _pieces(outline: F64) -> F64:
    """The same outline cut into pieces no longer than PIECE, or a thousandth of the whole."""
    length = np.sqrt(((outline[:, 1] - outline[:, 0]) ** 2).sum(1))
    many = np.ceil(length / max(PIECE, float(length.sum()) / 1000)).astype(np.int64)
    owner = np.repeat(np.arange(len(outline)), many)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(many) - many, many)
    start, along = outline[owner, 0], outline[owner, 1] - outline[owner, 0]
    low, high = (rank / many[owner])[:, None], ((rank + 1) / many[owner])[:, None]
    return np.stack([start + low * along, start + high * along], 1)


def _guarded(pieces: F64, rim: F64, middle: F64, walls: F64) -> NDArray[np.bool_]:
    """(S,) whether a wall stands at a piece of the edge, or between it and the base.

    The way starts a little inside the base, because what touches a wall overlaps it a little, and
    ends a little beyond the edge, because a wall may stand just outside.
    """
    end = pieces.mean(1)
    along = pieces[:, 1] - pieces[:, 0]
    out = np.stack([along[:, 1], -along[:, 0]], 1)
    out /= np.sqrt((out**2).sum(1, keepdims=True))
    start = nearest_on(end, rim).foot
    inward = middle - start
    norm = np.maximum(np.sqrt((inward**2).sum(1, keepdims=True)), 1e-300)
    start = start + inward / norm * np.minimum(CONTACT_TOLERANCE, norm)
    return crosses(start, end, walls) | crosses(end, end + WALL_GAP * out, walls)
