"""Convex hulls in the horizontal plane, many at once, and how far points lie within them.

A polygon is an (N, 2) array of corners in metres, counter-clockwise; N may be 1 or 2 for a point
or a segment. Many outlines are an array of shapely geometries.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]
Outlines = NDArray[Any]
"""Of shapely geometries; None where there is none."""

COINCIDENT = 1e-9
"""m. What is closer than this touches."""

SLENDER = 1e-4
"""m. Points on a line to within this span no polygon: it is the height of a triangle over its longest side."""


def hulls(points: F64, owner: I64, many: int) -> Outlines:
    """(many,) convex hulls of the points (N, 2) of each owner (N,), 0 … many − 1; None of no points.

    Polygons go around counter-clockwise.
    """
    order, out = np.argsort(owner, kind="stable"), np.full(many, None)
    alone = np.bincount(owner, minlength=many)[owner[order]] == 1
    order = np.repeat(order, 1 + alone)  # a line has two ends, a hull may have one
    if len(points):
        shapely.linestrings(points[order], indices=owner[order], out=out)
    return np.asarray(shapely.orient_polygons(shapely.convex_hull(out)))


def convex_hull(points: F64) -> F64:
    """(M, 2) corners of the convex hull of points (N, 2), counter-clockwise."""
    corners = shapely.get_coordinates(hulls(points, np.zeros(len(points), np.int64), 1))
    return np.asarray(corners if len(corners) < 4 else corners[:-1])


def outward(polygon: F64) -> F64:
    """(N, 2) unit normals of the edges, edge i from corner i to the next."""
    edge = np.roll(polygon, -1, 0) - polygon
    return np.asarray(
        np.stack([edge[:, 1], -edge[:, 0]], 1) / np.sqrt((edge**2).sum(1, keepdims=True))
    )


def contains(polygon: F64, points: F64) -> Bool:
    """(N,) whether points (N, 2) lie in a convex polygon, its boundary included."""
    if len(polygon) < 3:
        return np.zeros(len(points), np.bool_)
    beyond = ((points[:, None] - polygon) * outward(polygon)).sum(-1)
    return np.asarray((beyond <= COINCIDENT).all(1))


def clip(subject: F64, window: F64, slack: float = 0.0) -> F64:
    """(N, 2) the part of a convex polygon, segment or point in a window of at least three corners.

    Sutherland & Hodgman 1974. Corners less than ``slack`` (m) outside count as inside; corners may
    occur twice.
    """
    part = subject
    for normal, corner in zip(outward(window), window, strict=True):
        beyond = (part - corner) @ normal
        out = beyond > slack
        if out.any():
            following, later = np.roll(part, -1, 0), np.roll(beyond, -1)
            cut = out != np.roll(out, -1)
            share = beyond[cut] / (beyond[cut] - later[cut])
            corners = part[cut] + share[:, None] * (following[cut] - part[cut])
            order = np.argsort(np.concatenate([np.flatnonzero(~out), np.flatnonzero(cut) + 0.5]))
            part = np.concatenate([part[~out], corners])[order]
    return part


def polygon_margin(points: F64, owner: I64, centre: F64) -> F64:
    """Signed distance from projected weights to the boundaries of their support polygons.

    Args:
        points: (P, 2) m, support points in the horizontal plane.
        owner: (P,) which of the N polygons each point belongs to, 0 … N − 1, in any order.
        centre: (N, 2) m, the projected centres of mass.

    Returns:
        (N,) m: within the convex hull of its points the distance to the nearest edge; outside
        minus the distance to the hull; NaN where fewer than three points are given or all lie on
        a line to within ``SLENDER``, or where the centre is not known.
    """
    return hull_margin(hulls(points, owner, len(centre)), centre)


def hull_margin(outlines: Outlines, centre: F64) -> F64:
    """(N,) m, as ``polygon_margin``, of convex outlines (N,) and points (N, 2)."""
    out = np.full(len(centre), np.nan)
    wide = shapely.area(outlines) >= SLENDER / 4 * shapely.length(outlines)
    wide = np.flatnonzero(
        wide & (shapely.get_dimensions(outlines) == 2) & np.isfinite(centre).all(1)
    )
    x, y = centre[wide].T
    apart = shapely.distance(shapely.boundary(outlines[wide]), shapely.points(x, y))
    out[wide] = np.where(shapely.intersects_xy(outlines[wide], x, y), apart, -apart)
    return out
