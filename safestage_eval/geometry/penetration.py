"""Certified penetration depth of two convex geoms whose cores meet.

The depth is the length of the shortest move that parts them: the least, over unit directions n, of
the overlap h(n), where h is the support function of the Minkowski difference A − B. Van den Bergen
2001, "Proximity queries and penetration depth computation on 3D game objects": a polytope of
support points grows inside A − B, at its faces nearest to the origin. The depth is at least the
least of their heights over the origin, because the polytope lies within A − B, and at most h of any
direction that was tried.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Support = Callable[[F64], F64]
"""(M, 3) the points of a difference A − B that are farthest along directions (M, 3)."""

DEPTH_TOLERANCE = 1e-7
"""m, between the bounds at which the search ends."""

CORNERS = 4096
"""Support points at most. Only round geoms around one axis need so many; there the interval may be
a little wider than DEPTH_TOLERANCE, and holds the depth as well."""

AT_ONCE = 16
"""Nearest faces at which the polytope grows in one step; or an eighth of its corners, if that is more."""


def penetration_depth(
    farthest: Support, upper: float, enough: float, *, flat: bool
) -> tuple[float, float]:
    """Bounds (lower, upper) m on the depth of one pair of geoms without their margins.

    The cores must meet. ``upper`` (m) is a bound that is known already. It ends early when the depth
    is known to be at most ``enough`` (m). With ``flat``, all points are at height 0.
    """
    from scipy.spatial import ConvexHull, QhullError

    axes = 2 if flat else 3
    directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=axes) if any(d)])
    points, reach = _reach(farthest, directions / np.linalg.norm(directions, axis=1, keepdims=True))
    upper, lower = min(upper, float(reach.min())), 0.0
    try:
        hull = ConvexHull(points, incremental=True)
    except QhullError:  # flat: the depth is at most its thickness
        thin = np.linalg.svd(points - points.mean(0))[2][-1:]
        return 0.0, max(
            min(upper, *(float(_reach(farthest, s * thin)[1][0]) for s in (-1, 1))), 0.0
        )
    while True:
        height = -hull.equations[:, -1]
        many = max(AT_ONCE, len(hull.points) // 8)
        nearest = np.argsort(height)[: 4 * many]
        lower = max(lower, float(height[nearest[0]]))
        if upper - lower <= DEPTH_TOLERANCE or upper <= enough or len(hull.points) >= CORNERS:
            break
        normals = np.unique(np.round(hull.equations[nearest, :-1], 9), axis=0, return_index=True)[1]
        rows = nearest[np.sort(normals)[:many]]
        points, reach = _reach(farthest, hull.equations[rows, :-1])
        upper = min(upper, float(reach.min()))
        beyond = reach > height[rows] + 1e-15 * (1 + np.abs(points).max())
        if not beyond[0]:
            break
        hull.add_points(np.unique(points[beyond], axis=0))
    return min(lower, max(upper, 0.0)), max(upper, 0.0)


def _reach(farthest: Support, normals: F64) -> tuple[F64, F64]:
    """The farthest points (M, 2 or 3) of the difference along unit normals, and how far (M,) they are."""
    axes = normals.shape[1]
    directions = np.zeros((len(normals), 3))
    directions[:, :axes] = normals
    points = farthest(directions)[:, :axes]
    return points, (points * normals).sum(1)
