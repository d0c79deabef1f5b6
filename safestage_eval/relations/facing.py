"""Where two sides that face each other overlap: corners of the patch, at many frames in one call."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CORNERS = 12
"""Points that stand for a round outline: the patch is 3 % smaller at most."""
THIN = 1e-9
"""m: half the width that an edge or a point is given, to be an outline."""


def overlap(first: F64, second: F64, normal: F64, play: F64, room: float) -> tuple[F64, I64]:
    """(P, 3) m, corners of where the two sides overlap, by frame; (F,) how many there are.

    Args:
        first: (F, V, 3) m, corners of a convex solid, or (1, V, 3) if it stays; V = 0 of a plane,
            which is everywhere.
        second: the same of another.
        normal: (F, 3) unit, from the first to the second.
        play: (F, 2) m, how far behind the foremost a corner of either still counts.
        room: m, by which the second's outline is widened.
    """
    across = np.stack(_span(normal), axis=1)
    sides = [
        _side(corners, sign, normal, across, play[:, k])
        for k, (corners, sign) in enumerate(((first, 1.0), (second, -1.0)))
        if corners.shape[1]
    ]
    outlines = [outline for outline, _ in sides]
    patch = outlines[0]
    if len(sides) == 2:
        wide = shapely.buffer(
            outlines[1], room + THIN, cap_style="square", join_style="mitre", mitre_limit=1e9
        )
        patch = shapely.intersection(patch, wide)
    level = np.mean([height for _, height in sides], axis=0)
    flat, frame = _corners(patch)
    points = np.einsum("pa,pai->pi", flat, across[frame]) + (level[:, None] * normal)[frame]
    return points, np.bincount(frame, minlength=len(normal)).astype(np.int64)


def _span(normal: F64) -> tuple[F64, F64]:
    """Two unit axes (F, 3) each across normals (F, 3)."""
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    one = np.cross(normal, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(normal, one)


def _side(
    corners: F64, sign: float, normal: F64, across: F64, play: F64
) -> tuple[NDArray[Any], F64]:
    """(F,) outlines of the foremost corners (F, V, 3) along ± the normal; (F,) m, their level along it."""
    corners = np.broadcast_to(corners, (len(normal), *corners.shape[1:]))
    height = np.einsum("fvi,fi->fv", corners, normal)
    foremost = sign * height >= ((sign * height).max(axis=1) - play)[:, None]
    level = np.where(foremost, height, 0.0).sum(axis=1) / foremost.sum(axis=1)
    plane = np.einsum("fvi,fai->fva", corners, across)
    frame = foremost.nonzero()[0]
    outline = shapely.convex_hull(shapely.multipoints(plane[foremost], indices=frame))
    some, owner = _corners(outline)
    many = np.bincount(owner, minlength=len(normal))
    if (many > CORNERS).any():  # enough of them to stand on
        place = np.arange(len(owner)) - (many.cumsum() - many)[owner]
        least = np.arange(CORNERS) * many[:, None] // CORNERS
        kept = (many <= CORNERS)[owner] | (place[:, None] == least[owner]).any(axis=1)
        thinned = shapely.multipoints(some[kept], indices=owner[kept])
        outline = shapely.convex_hull(thinned)
    return outline, level


def _corners(outline: NDArray[Any]) -> tuple[F64, I64]:
    """(P, 2) corners of polygons, edges and points (F,), each once, and (P,) of which it is one."""
    points, frame = shapely.get_coordinates(outline, return_index=True)
    last = np.append(frame[1:] != frame[:-1], True) & (shapely.get_dimensions(outline)[frame] == 2)
    return points[~last], frame[~last]
