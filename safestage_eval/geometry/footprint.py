"""Footprints: the areas that bodies cover when seen from above. Round geoms are right to 0.1 mm, the rest to rounding."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from .mover import Mover, frame_count, placed
from .polygon import Outlines, hull_margin, hulls
from .stillness import first_alike

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

OFF = 1e-3
"""m. A contact lies within this of either outline: bodies go into each other, and round ones have corners."""

SQUARE = OFF * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def overlap_xy(a: Mover, b: Mover, frames: I64 | None = None) -> F64:
    """Share, 0…1, of a's footprint area that lies over b's footprint.

    Args:
        a: the body whose footprint counts.
        b: the other body; a plane covers everything.
        frames: (N,) indices of the frames to measure; all when None. Frames in which both are where
            they were in another, to within 0.05 mm, have that one's value.

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
    (over, under), which = np.unique(
        np.stack([first_alike([mover], wanted) for mover in (a, b)]), axis=1, return_inverse=True
    )
    upper, lower = (footprints(*one) for one in ((a, over), (b, under)))
    area = shapely.area(upper)
    both = shapely.area(shapely.intersection(upper, lower))
    found = np.divide(both, area, out=np.full(len(area), np.nan), where=area > 0)
    share[wanted] = np.round(found, 12)[which]  # wholly over it is 1
    return share


def outline_margin(a: Mover, supports: Sequence[Mover], frames: I64, centre: F64) -> F64:
    """Signed distance (m) from points to the edge of all that can span where a body touches others.

    That is the convex hull of what a's outline shares with those of its supports' geoms, all
    seen from above: contacts between them, however many there are, span no more. A geom that lies
    lower than all of a (the foot of a post), or higher, touches it nowhere.

    Args:
        a: what stands.
        supports: what it stands on; a plane is everywhere.
        frames: (N,) ascending.
        centre: (N, 2) m, world.

    Returns:
        (N,) > 0 inside, < 0 outside; inf where the outlines share no area, a has no end, or the
        point is not known.
    """
    if any(part is None for part in a.shape.polytopes):
        return np.full(len(frames), np.inf)
    poses, which = np.unique(first_alike((a, *supports), frames), return_inverse=True)
    points = placed(a, poses, np.concatenate([part.vertices for part in a.shape.polytopes if part]))
    own, low, high = _outlines(points), points[..., 2].min(1) - OFF, points[..., 2].max(1) + OFF
    shared: list[Outlines] = [np.full(len(poses), None)]
    for support in supports:
        for part in support.shape.polytopes:
            if part is None:
                shared.append(own)
                continue
            points = placed(support, poses, part.vertices)
            level = (points[..., 2].max(1) >= low) & (points[..., 2].min(1) <= high)
            found = shapely.intersection(own, _outlines(points))
            found[~level | ~(shapely.area(found) > 0)] = None
            shared.append(found)
    whole = shapely.convex_hull(shapely.union_all(np.stack(shared, 1), axis=1))[which]
    margin = hull_margin(whole, centre)
    return np.where(np.isnan(margin), np.inf, margin)


def footprints(mover: Mover, frames: I64) -> Outlines:
    """(N,) what a body covers at some frames."""
    poses, which = np.unique(frames, return_inverse=True)
    corners = np.diff(mover.shape.pieces.first)
    n, many = len(poses), len(corners)
    points = placed(mover, poses, mover.shape.pieces.vertices)[..., :2].reshape(-1, 2)
    owner = np.repeat(np.arange(n * many), np.tile(corners, n))
    found = hulls(points, owner, n * many).reshape(n, many)
    found[shapely.get_type_id(found) != shapely.GeometryType.POLYGON] = None
    return np.asarray(shapely.union_all(found, axis=1)[which])


def _outlines(points: F64) -> Outlines:
    """(N,) convex hulls of points (N, V, 3) seen from above, and of all within ``OFF`` of them."""
    many = len(points)
    owner = np.repeat(np.arange(many), points.shape[1])
    inner = hulls(points[..., :2].reshape(-1, 2), owner, many)
    corners, owner = shapely.get_coordinates(inner, return_index=True)
    return hulls((corners[:, None] + SQUARE).reshape(-1, 2), np.repeat(owner, 4), many)
