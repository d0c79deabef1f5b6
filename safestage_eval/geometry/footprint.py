"""What bodies cover when seen from above. Round geoms are right to 0.1 mm, the rest to rounding."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .clearance import Clearance, clearance_series
from .mover import Mover, frame_count, still_runs
from .polygon import contains, convex_hull, union_area
from .polytope import Polytope
from .pose import transform

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

STILL_DISTANCE, STILL_ANGLE = 1e-5, 1e-4
"""m and rad. Outlines of bodies that moved less are not computed anew."""


def clearance_xy(a: Sequence[Mover], b: Sequence[Mover], cap: float = np.inf) -> Clearance:
    """(T,) distance of the projections of two groups onto the horizontal plane.

    Certified as clearance_series, by the same pruning; round geoms are not approximated here.
    Zero or less where the projections overlap.
    """
    return clearance_series(a, b, cap, flat=True)


def overlap_xy(a: Mover, b: Mover, frames: I64 | None = None) -> F64:
    """Share, 0…1, of a's footprint area that lies over b's footprint.

    Args:
        a: the body whose footprint counts.
        b: the other body; a plane covers everything.
        frames: (N,) indices of the frames to measure; all when None.

    Returns:
        (T,); NaN in frames not asked for, and where a covers no area.
    """
    total = frame_count(a, b)
    wanted = np.arange(total) if frames is None else frames
    total = max(total, int(wanted.max(initial=-1)) + 1)  # nothing moves, yet later frames are meant
    share = np.full(total, np.nan)
    for frame, alike in still_runs((a, b), wanted, STILL_DISTANCE, STILL_ANGLE):
        over, under = footprint(a, frame), footprint(b, frame)
        share[alike] = (
            1.0 if any(part is None for part in b.shape.polytopes) else _share(over, under)
        )
    return share


def footprint(mover: Mover, frame: int) -> list[F64]:
    """One convex polygon (N, 2) m, world, per geom but planes; per triangle of a nonconvex mesh."""
    found = []
    for part, points in world_vertices(mover, frame):
        corners = [points] if part.convex else [points[face] for face in part.faces]
        found += [convex_hull(c[:, :2]) for c in corners]
    return found


def world_vertices(mover: Mover, frame: int) -> list[tuple[Polytope, F64]]:
    """Each geom's polytope with its vertices (V, 3) m, world, at a frame; planes are left out."""
    t = frame if len(mover) > 1 else 0
    position, orientation = mover.position[t], mover.orientation[t]
    return [
        (part, transform(position, orientation, part.vertices))
        for part in mover.shape.polytopes
        if part is not None
    ]


def below(part: Polytope, points: F64, height: float) -> F64:
    """(N, 2) corners of the projection of what lies at or under a height: points (V, 3), world."""
    under = points[:, 2] <= height
    return np.concatenate([points[under, :2], section(part, points, height)])


def section(part: Polytope, points: F64, height: float) -> F64:
    """(N, 2) m where a polytope's edges pass through a horizontal plane; points (V, 3), world."""
    a, b = points[part.edges[:, 0]], points[part.edges[:, 1]]
    through = (a[:, 2] <= height) != (b[:, 2] <= height)
    a, b = a[through], b[through]
    share = (height - a[:, 2]) / (b[:, 2] - a[:, 2])
    return np.asarray(a[:, :2] + share[:, None] * (b[:, :2] - a[:, :2]))


def _share(over: list[F64], under: list[F64]) -> float:
    area = union_area(over)
    if area <= 0:
        return np.nan
    if len(under) == 1 and contains(under, np.concatenate(over)).all():
        return 1.0
    both = area + union_area(under) - union_area(over + under)
    return float(np.clip(both / area, 0.0, 1.0))
