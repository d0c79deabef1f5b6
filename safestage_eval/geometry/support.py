"""How far convex geoms reach in a direction, and where.

Schneider & Eberly, "Geometric tools for computer graphics", ch. 11; the ellipsoid's follows from
mapping it to the unit ball.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .shape import CYLINDER, ELLIPSOID, HULL, Solids

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


def support_points(solids: Solids, which: I64, direction: F64) -> F64:
    """(N, 3) the points of geoms' cores that are farthest along directions.

    Of geoms ``which`` (N,), none of them a plane; directions (N, 3) and points in each geom's own
    axes, from its centre. Margins are left out. Where several points are equally far, one of them.
    """
    size, kinds = solids.size[which], solids.kind[which]
    out = np.where(direction >= 0, size, -size)  # of points, segments and boxes
    round_ = np.flatnonzero(kinds == CYLINDER)
    if len(round_):
        d = direction[round_, :2]
        radial = np.sqrt((d * d).sum(1, keepdims=True))
        along = np.divide(d, radial, out=np.tile([1.0, 0.0], (len(d), 1)), where=radial > 0)
        out[round_, :2] = size[round_, :1] * along
    egg = np.flatnonzero(kinds == ELLIPSOID)
    if len(egg):
        d = size[egg] * direction[egg]
        norm = np.sqrt((d * d).sum(1, keepdims=True))
        out[egg] = size[egg] * np.divide(d, norm, out=np.zeros_like(d), where=norm > 0)
    hulls = np.flatnonzero(kinds == HULL)
    for g in np.unique(which[hulls]).tolist():
        rows = hulls[which[hulls] == g]
        out[rows] = solids.corners[g].farthest(direction[rows])
    return out


def support_values(solids: Solids, which: I64, direction: F64) -> F64:
    """(N,) m, how far geoms reach along unit directions, margins included; as ``support_points``."""
    points = support_points(solids, which, direction)
    return np.asarray((points * direction).sum(1) + solids.margin[which])
