"""The convex hull of points in space, as triangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

FLAT = 1e-7
"""Share of their size below which points are flat."""


class Triangles(NamedTuple):
    """The F outward triangles of a hull.

    Attributes:
        corners: (F, 3) rows of the points, counter-clockwise seen from outside.
        planes: (F, 4) outward unit normal, and minus the plane's height over the origin (m).
    """

    corners: I64
    planes: F64


def hull_triangles(points: F64) -> Triangles | None:
    """The hull of points (N, 3) m by Qhull; None where they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    centred = points - points.mean(0)
    if (
        len(points) < 4
        or np.linalg.svd(centred, compute_uv=False)[-1] <= FLAT * np.abs(centred).max()
    ):
        return None
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    corners = hull.simplices.astype(np.int64)
    first, second, third = (points[corners[:, i]] for i in range(3))
    inward = (np.cross(second - first, third - first) * hull.equations[:, :3]).sum(1) < 0
    corners[inward] = corners[inward][:, ::-1]
    return Triangles(corners, hull.equations)
