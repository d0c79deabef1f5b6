"""Certified penetration depths of convex geoms whose cores meet.

The depth is the length of the shortest move that parts them: the least, over unit directions n, of
the overlap h(n), where h is the support function of the Minkowski difference A − B. Van den Bergen
2001, "Proximity queries and penetration depth computation on 3D game objects": a polytope of
support points grows inside A − B, at its faces nearest to the origin. The depth is at least the
least of their heights over the origin, because the polytope lies within A − B, and at most h of any
direction that was tried.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from itertools import product

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Support = Callable[[NDArray[np.int64], F64], F64]
"""Takes pairs (M,) and directions (M, 3); gives the farthest point (M, 3) of each pair's A − B that way."""

DEPTH_TOLERANCE = 1e-7
"""m, between the bounds at which the search ends."""

CORNERS = 4096
"""Support points at most. Only round geoms around one axis need so many; there the interval may be
a little wider than DEPTH_TOLERANCE, and holds the depth as well."""

PAIRS_AT_ONCE = 256
"""Searches that go on side by side."""

AT_ONCE = 16
"""Nearest faces at which the polytope grows in one step; or an eighth of its corners, if that is more."""


def penetration_depths(
    farthest: Support,
    upper: F64,
    enough: F64,
    tolerance: float = DEPTH_TOLERANCE,
    *,
    flat: bool,
) -> tuple[F64, F64]:
    """Bounds (lower, upper) (N,) m on the depths of pairs of geoms without their margins.

    The cores must meet. ``upper`` (N,) m are bounds that are known already. A search ends early when
    the depth is known to be at most ``enough`` (N,) m, or to ``tolerance`` (m). With ``flat``, all
    points are at height 0. All pairs of a round are asked for their points in one call.
    """
    axes, out = 2 if flat else 3, np.empty((len(upper), 2))
    for begin in range(0, len(upper), PAIRS_AT_ONCE):
        some = range(begin, min(begin + PAIRS_AT_ONCE, len(upper)))
        searches = {n: _search(float(upper[n]), float(enough[n]), tolerance, axes) for n in some}
        asked = {n: next(search) for n, search in searches.items()}
        while asked:
            ends = np.cumsum([len(normals) for normals in asked.values()])
            directions = np.zeros((ends[-1], 3))
            directions[:, :axes] = np.concatenate(list(asked.values()))
            pairs = np.repeat(list(asked), np.diff(ends, prepend=0))
            points = np.split(farthest(pairs, directions)[:, :axes], ends[:-1])
            for n, found in zip(list(asked), points, strict=True):
                try:
                    asked[n] = searches[n].send(found)
                except StopIteration as end:
                    out[n] = end.value
                    del asked[n]
    return out[:, 0], out[:, 1]


def _search(
    upper: float, enough: float, tolerance: float, axes: int
) -> Generator[F64, F64, tuple[float, float]]:
    """Asks for the farthest points along unit normals (M, axes), until it knows the depth's bounds, m."""
    from scipy.spatial import ConvexHull, QhullError

    directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=axes) if any(d)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = yield directions
    upper, lower = min(upper, float((points * directions).sum(1).min())), 0.0
    try:
        hull = ConvexHull(points, incremental=True)
    except QhullError:  # flat: the depth is at most its thickness
        thin = np.linalg.svd(points - points.mean(0))[2][-1] * [[1.0], [-1.0]]
        points = yield thin
        return 0.0, max(min(upper, float((points * thin).sum(1).min())), 0.0)
    while True:
        height = -hull.equations[:, -1]
        many = max(AT_ONCE, len(hull.points) // 8)
        nearest = np.argsort(height)[: 4 * many]
        lower = max(lower, float(height[nearest[0]]))
        if upper - lower <= tolerance or upper <= enough or len(hull.points) >= CORNERS:
            break
        first = np.unique(np.round(hull.equations[nearest, :-1], 9), axis=0, return_index=True)[1]
        rows = nearest[np.sort(first)[:many]]
        normals = hull.equations[rows, :-1]
        points = yield normals
        reach = (points * normals).sum(1)
        upper = min(upper, float(reach.min()))
        beyond = reach > height[rows] + 1e-15 * (1 + np.abs(points).max())
        if not beyond[0]:
            break
        hull.add_points(np.unique(points[beyond], axis=0))
    return min(lower, max(upper, 0.0)), max(upper, 0.0)
