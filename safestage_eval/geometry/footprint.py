"""Footprints: the areas that bodies cover when seen from above. Round geoms are right to 0.1 mm, the rest to rounding."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel

from .mover import Mover, frame_count, rotation_at
from .polygon import COINCIDENT, bounds, chain, covers, sort_points
from .polytope import Pieces
from .pose import unit
from .stillness import still_since

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

SPREAD = 1e-8
"""m², twice an area that is certainly one."""


def overlap_xy(a: Mover, b: Mover, frames: I64 | None = None) -> F64:
    """Share, 0…1, of a's footprint area that lies over b's footprint.

    Args:
        a: the body whose footprint counts.
        b: the other body; a plane covers everything.
        frames: (N,) indices of the frames to measure; all when None. Frames in which nothing has
            moved by 10 µm or 1e-4 rad repeat the value.

    Returns:
        (T,); NaN in frames not asked for, and where a covers no area.

    Raises:
        ValueError: an orientation is no rotation (norm 0 or not finite).
    """
    total = frame_count(a, b)
    wanted = np.arange(total) if frames is None else frames
    total = max(total, int(wanted.max(initial=-1)) + 1)  # nothing moves, yet later frames are meant
    share = np.full(total, np.nan)
    if any(part is None for part in b.shape.polytopes):
        share[wanted] = 1.0
        return share
    runs, which = np.unique(still_since((a, b), wanted), return_inverse=True)
    shares = np.empty(len(runs))
    over, under = a.shape.pieces, b.shape.pieces
    _shares(over, under, *_poses(a, runs), *_poses(b, runs), _Room.of(over, under), shares)
    share[wanted] = shares[which]
    return share


def _poses(mover: Mover, frames: I64) -> tuple[F64, F64]:
    at = frames if len(mover) > 1 else np.zeros_like(frames)
    return mover.position[at].astype(np.float64), unit(mover.orientation[at])


class _Room(NamedTuple):
    """Scratch memory of the kernels; over's pieces come first, then under's.

    Attributes:
        rotation: (3, 3).
        points, hull: corners of one piece as projected, and of its hull.
        corners: (C, 2) m, of all hulls.
        first, many: (P,) where each hull begins in ``corners``, and how many corners it has.
        solid_first, solid_many, box: the same of the hulls that have an area and may matter, and
            (P, 4) what they lie in.
        covered: (P, 4), as ``polygon.covers`` takes it.
        cut, other: (C, 2) m, a polygon that is being clipped.
    """

    rotation: F64
    points: F64
    hull: F64
    corners: F64
    first: I64
    many: I64
    solid_first: I64
    solid_many: I64
    box: F64
    covered: F64
    cut: F64
    other: F64

    @classmethod
    def of(cls, over: Pieces, under: Pieces) -> _Room:
        corners = len(over.vertices) + len(under.vertices)
        count = len(over.first) + len(under.first) - 2
        most = int(max(np.diff(pieces.first).max(initial=0) for pieces in (over, under)))
        return cls(
            np.empty((3, 3)),
            np.empty((most, 2)),
            np.empty((2 * most, 2)),
            np.empty((corners, 2)),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.empty((count, 4)),
            np.zeros((count, 4)),
            np.empty((4 * most + 8, 2)),
            np.empty((4 * most + 8, 2)),
        )


@kernel
def _shares(
    over: Pieces, under: Pieces, over_at: F64, over_turn: F64, under_at: F64, under_turn: F64,
    room: _Room, share: F64,
) -> None:  # fmt: skip
    """Share of over's area over under's at each of R poses: positions (R, 3), unit (R, 4)."""
    upper, every = over.first.shape[0] - 1, room.first.shape[0]
    for r in range(share.shape[0]):
        _cast(over, over_at, over_turn, r, room, 0, 0)
        again = r > 0
        for i in range(4):
            again = again and under_turn[r, i] == under_turn[r - 1, i]
            again = again and (i == 3 or under_at[r, i] == under_at[r - 1, i])
        if not again:
            _cast(under, under_at, under_turn, r, room, upper, over.vertices.shape[0])
        solid = 0
        for p in range(upper):
            solid = _take(room, p, 0, solid)
        if every == upper + 1 and _spread(room, solid) and _within(room, upper):
            share[r] = 1.0
            continue
        area = _union_area(room, 0, solid)
        if not area > 0.0:
            share[r] = math.nan
            continue
        if every == upper + 1 and _within(room, upper):
            share[r] = 1.0
            continue
        both = solid
        for p in range(upper, every):
            taken = _take(room, p, solid, both)
            if taken > both and _near(room, solid, taken):
                both = taken
        if both == solid:
            share[r] = 0.0
        elif solid == 1 and both == 2:
            share[r] = min(_shared_area(room, 0, 1) / area, 1.0)
        else:
            rest = _union_area(room, solid, both) - _union_area(room, 0, both)
            share[r] = min(max((area + rest) / area, 0.0), 1.0)


@kernel
def _cast(
    pieces: Pieces, position: F64, orientation: F64, t: int, room: _Room, piece: int, corner: int
) -> None:
    """Write the hull of each piece's projection, from place ``piece`` and ``corner`` on."""
    rotation_at(orientation, t, room.rotation)
    for p in range(pieces.first.shape[0] - 1):
        start = pieces.first[p]
        n = pieces.first[p + 1] - start
        for k in range(n):
            for i in range(2):
                room.points[k, i] = position[t, i] + (
                    room.rotation[i, 0] * pieces.vertices[start + k, 0]
                    + room.rotation[i, 1] * pieces.vertices[start + k, 1]
                    + room.rotation[i, 2] * pieces.vertices[start + k, 2]
                )
        sort_points(room.points, n)
        corners = chain(room.points[:n], room.hull)
        room.first[piece + p], room.many[piece + p] = corner + start, corners
        for k in range(corners):
            room.corners[corner + start + k, 0] = room.hull[k, 0]
            room.corners[corner + start + k, 1] = room.hull[k, 1]


@kernel
def _take(room: _Room, piece: int, begin: int, solid: int) -> int:
    """Add a piece to the solid ones from ``begin`` on; return how many solid ones there are then.

    It is left out if it has no area, or lies in one of them, as a copy does.
    """
    if room.many[piece] < 3:
        return solid
    room.solid_first[solid], room.solid_many[solid] = room.first[piece], room.many[piece]
    last = solid + 1
    bounds(
        room.corners, room.solid_first[solid:last], room.solid_many[solid:last], room.box[solid:]
    )
    for p in range(begin, solid):
        inside = (
            room.box[p, 0] <= room.box[solid, 0]
            and room.box[p, 1] <= room.box[solid, 1]
            and room.box[p, 2] >= room.box[solid, 2]
            and room.box[p, 3] >= room.box[solid, 3]
        )
        if inside and _holds(
            room, room.solid_first[p], room.solid_many[p], room.first[piece], room.many[piece], 0.0
        ):
            return solid
    return last


@kernel
def _holds(room: _Room, first: int, many: int, start: int, count: int, slack: float) -> bool:
    """Whether corners lie in a piece, or less than ``slack`` (m) outside each of its sides."""
    for k in range(many):
        x, y = room.corners[first + k, 0], room.corners[first + k, 1]
        after = first + (k + 1) % many
        dx, dy = room.corners[after, 0] - x, room.corners[after, 1] - y
        limit = slack * math.sqrt(dx * dx + dy * dy)
        for c in range(start, start + count):
            if (room.corners[c, 0] - x) * dy - (room.corners[c, 1] - y) * dx > limit:
                return False
    return True


@kernel
def _spread(room: _Room, solid: int) -> bool:
    """Whether some solid piece covers more than rounding could make up."""
    for p in range(solid):
        start, double = room.solid_first[p], 0.0
        for k in range(1, room.solid_many[p] - 1):
            ax = room.corners[start + k, 0] - room.corners[start, 0]
            ay = room.corners[start + k, 1] - room.corners[start, 1]
            bx = room.corners[start + k + 1, 0] - room.corners[start, 0]
            by = room.corners[start + k + 1, 1] - room.corners[start, 1]
            double += ax * by - ay * bx
        if double > SPREAD:
            return True
    return False


@kernel
def _near(room: _Room, solid: int, both: int) -> bool:
    """Whether the last of ``both`` touches the box of one of the first ``solid`` pieces."""
    last = both - 1
    for p in range(solid):
        if (
            room.box[p, 0] <= room.box[last, 2] + COINCIDENT
            and room.box[last, 0] <= room.box[p, 2] + COINCIDENT
            and room.box[p, 1] <= room.box[last, 3] + COINCIDENT
            and room.box[last, 1] <= room.box[p, 3] + COINCIDENT
        ):
            return True
    return False


@kernel
def _within(room: _Room, under: int) -> bool:
    """Whether all corners over it lie in the one piece under it."""
    start, n = room.first[under], room.many[under]
    if n < 3:
        return False
    for p in range(under):
        if not _holds(room, start, n, room.first[p], room.many[p], COINCIDENT):
            return False
    return True


@kernel
def _union_area(room: _Room, begin: int, end: int) -> float:
    """m², of the solid pieces from ``begin`` to ``end``, by Green's theorem over their outline."""
    first, count, box = room.solid_first[begin:end], room.solid_many[begin:end], room.box[begin:]
    if end == begin:
        return 0.0
    x0, y0 = room.corners[first[0], 0], room.corners[first[0], 1]
    double = 0.0
    for i in range(end - begin):
        for c in range(count[i]):
            ax, ay = room.corners[first[i] + c, 0], room.corners[first[i] + c, 1]
            following = first[i] + (c + 1) % count[i]
            dx, dy = room.corners[following, 0] - ax, room.corners[following, 1] - ay
            if math.sqrt(dx * dx + dy * dy) <= COINCIDENT:
                continue
            spans = covers(room.corners, first, count, box, i, ax, ay, dx, dy, room.covered)
            free, reached = 1.0, 0.0
            for k in range(spans):
                free -= max(room.covered[k, 1] - max(room.covered[k, 0], reached), 0.0)
                reached = max(reached, room.covered[k, 1])
            # any part of the edge has the same lever about the origin
            double += free * ((ax - x0) * dy - (ay - y0) * dx)
    return double / 2.0


@kernel
def _shared_area(room: _Room, one: int, other: int) -> float:
    """m² that two solid pieces share. Sutherland & Hodgman 1974."""
    source, target = room.cut, room.other
    n = room.solid_many[one]
    for k in range(n):
        source[k, 0] = room.corners[room.solid_first[one] + k, 0]
        source[k, 1] = room.corners[room.solid_first[one] + k, 1]
    start, many = room.solid_first[other], room.solid_many[other]
    for e in range(many):
        x, y = room.corners[start + e, 0], room.corners[start + e, 1]
        after = start + (e + 1) % many
        dx, dy = room.corners[after, 0] - x, room.corners[after, 1] - y
        written = 0
        for k in range(n):
            px, py = source[k, 0], source[k, 1]
            qx, qy = source[(k + 1) % n, 0], source[(k + 1) % n, 1]
            here, there = (px - x) * dy - (py - y) * dx, (qx - x) * dy - (qy - y) * dx
            if here <= 0.0:
                target[written, 0], target[written, 1] = px, py
                written += 1
            if (here > 0.0) != (there > 0.0):
                at = here / (here - there)
                target[written, 0], target[written, 1] = px + at * (qx - px), py + at * (qy - py)
                written += 1
        source, target, n = target, source, written
        if n < 3:
            return 0.0
    double = 0.0
    for k in range(1, n - 1):
        ax, ay = source[k, 0] - source[0, 0], source[k, 1] - source[0, 1]
        bx, by = source[k + 1, 0] - source[0, 0], source[k + 1, 1] - source[0, 1]
        double += ax * by - ay * bx
    return double / 2.0
