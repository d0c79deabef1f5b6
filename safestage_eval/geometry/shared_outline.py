"""Where a body can touch what is under it, seen from above: within both outlines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .ground import world_vertices
from .mover import Mover
from .polygon import convex_hull, overlap
from .stability import polygon_margin
from .stillness import still_runs

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

OFF = 1e-3
"""m. A contact lies within this of either outline: bodies go into each other, and round ones have corners."""


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
        (N,) > 0 inside, < 0 outside; inf where the outlines are apart or a has no end.
    """
    out = np.full(len(frames), np.inf)
    if any(part is None for part in a.shape.polytopes):
        return out
    for frame, alike in still_runs((a, *supports), frames):
        corners = _shared(a, supports, frame)
        if len(corners):
            here = np.isin(frames, alike)
            many = int(here.sum())
            owner = np.repeat(np.arange(many), len(corners))
            out[here] = polygon_margin(np.tile(corners, (many, 1)), owner, centre[here])
    return out


def _shared(a: Mover, supports: Sequence[Mover], frame: int) -> F64:
    """(K, 2) m, corners of what a's outline shares with others'."""
    points = np.concatenate([points for _, points in world_vertices(a, frame)])
    own, low, high = _outline(points), points[:, 2].min() - OFF, points[:, 2].max() + OFF
    found = [np.empty((0, 2))]
    for support in supports:
        if any(part is None for part in support.shape.polytopes):
            return own
        for _, points in world_vertices(support, frame):
            if points[:, 2].max() >= low and points[:, 2].min() <= high:
                found.append(overlap(own, _outline(points)))
    return np.concatenate(found)


def _outline(points: F64) -> F64:
    """(K, 2) the convex hull of points (V, 3) seen from above, and of all within ``OFF`` of it."""
    square = OFF * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return convex_hull((points[:, None, :2] + square).reshape(-1, 2))
