"""How far a weight is from tipping over the edge of the points it stands on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, kernel

from .arrays import owned
from .polygon import chain, sort_points

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

SLENDER = 1e-4
"""m. Points on a line to within this span no polygon."""


def polygon_margin(points: F64, owner: I64, centre: F64) -> F64:
    """Signed distance from projected weights to the boundaries of their support polygons.

    Args:
        points: (P, 2) m, support points in the horizontal plane.
        owner: (P,) which of the N polygons each point belongs to, 0 … N − 1, in any order.
        centre: (N, 2) m, the projected centres of mass.

    Returns:
        (N,) m: within the convex hull of its points the distance to the nearest edge; outside
        minus the distance to the hull; NaN where fewer than three points are given or all lie on
        a line to within ``SLENDER``.
    """
    order = np.argsort(owner, kind="stable")
    many = np.bincount(owner, minlength=len(centre)).astype(np.int64)
    out = np.empty(len(centre))
    _margins(owned(points[order]), np.cumsum(many) - many, many, owned(centre), out)
    return out


@allocating
def _margins(points: F64, first: I64, many: I64, centre: F64, out: F64) -> None:
    hull = np.empty((2 * len(points) + 1, 2))
    for n in range(many.shape[0]):
        out[n] = np.nan
        if many[n] < 3:
            continue
        own = points[first[n] : first[n] + many[n]]
        sort_points(own, many[n])
        corners = chain(own, hull)
        out[n] = _margin(hull, corners, centre[n, 0], centre[n, 1])


@kernel
def _margin(hull: F64, corners: int, x: float, y: float) -> float:
    """Signed distance of one point to a counter-clockwise hull; NaN if that is thinner than SLENDER."""
    if corners < 3:
        return np.nan
    level, apart, width = np.inf, np.inf, np.inf
    for i in range(corners):
        ax, ay = hull[i, 0], hull[i, 1]
        dx, dy = hull[(i + 1) % corners, 0] - ax, hull[(i + 1) % corners, 1] - ay
        length = math.sqrt(dx * dx + dy * dy)
        reach = 0.0
        for j in range(corners):
            reach = max(reach, (dx * (hull[j, 1] - ay) - dy * (hull[j, 0] - ax)) / length)
        width = min(width, reach)
        level = min(level, (dx * (y - ay) - dy * (x - ax)) / length)
        share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / (length * length)))
        px, py = x - ax - share * dx, y - ay - share * dy
        apart = min(apart, math.sqrt(px * px + py * py))
    if width < SLENDER:
        return np.nan
    return level if level >= 0 else -apart
