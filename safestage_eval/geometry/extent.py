"""Extent of a body: its lowest and highest point, its reach in any direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .mover import Mover
from .pose import matrix
from .shape import CYLINDER, ELLIPSOID, HULL, PLANE, Solids
from .support import support_values

F64 = NDArray[np.float64]

FLAT = 0.02
"""rad. A face tilted by less counts as facing the direction squarely: its middle is returned."""


def reach(mover: Mover, direction: ArrayLike) -> F64:
    """(T,) m: the largest coordinate of the body's points along ``direction``, from the origin.

    Args:
        mover: the body; T frames.
        direction: (3,) or (T, 3), world, any length but 0.

    A body without geoms reaches −inf, a plane +inf except along its normal.
    """
    d = np.atleast_2d(np.asarray(direction, np.float64))
    norm = np.sqrt((d * d).sum(1, keepdims=True))
    if d.shape[1:] != (3,) or not (norm > 0).all():
        raise ValueError(f"directions of shape {d.shape} must be (3,) or (T, 3) and not zero")
    d = d / norm
    local, which = _turned(mover, d)
    best = np.full(len(local), -np.inf)
    solids, centre = mover.shape.solids, mover.shape.centre
    for g in range(len(solids.kind)):
        own = _times(local, solids.rotation[g])
        if solids.kind[g] == PLANE:
            far = np.where(own[:, 2] > 1 - 1e-12, 0.0, np.inf)
        else:
            far = support_values(solids, np.full(len(own), g), own)
        np.maximum(best, far + (local * (solids.offset[g] + centre)).sum(1), out=best)
    return np.asarray((mover.position * d).sum(1) + best[which])


def highest(mover: Mover) -> F64:
    """(T,) m, world z of the body's highest point; +inf for a plane that is not level."""
    return reach(mover, (0.0, 0.0, 1.0))


def lowest(mover: Mover) -> F64:
    """(T,) m, world z of the body's lowest point; −inf for a plane (it is a half-space)."""
    return -reach(mover, (0.0, 0.0, -1.0))


def farthest_point(mover: Mover, direction: ArrayLike) -> F64:
    """(T, 3) m, world: the point of the body farthest along ``direction`` ((3,) or (T, 3), world).

    Where a face looks that way to within ``FLAT``, the middle of the face; planes are left out.
    NaN for a body without other geoms.
    """
    d = np.atleast_2d(np.asarray(direction, np.float64))
    local, which = _turned(mover, d / np.sqrt((d * d).sum(1, keepdims=True)))
    best, point = np.full(len(local), -np.inf), np.full((len(local), 3), np.nan)
    solids, centre = mover.shape.solids, mover.shape.centre
    for g in np.flatnonzero(solids.kind != PLANE).tolist():
        place = _face_middle(solids, g, _times(local, solids.rotation[g]))
        place = _times(place, solids.rotation[g].T) + solids.offset[g] + centre
        along = (place * local).sum(1)
        point = np.where((along > best)[:, None], place, point)
        best = np.maximum(best, along)
    turn = matrix(mover.orientation)
    return np.asarray(mover.position + (turn * point[which][:, None]).sum(-1))


def _turned(mover: Mover, direction: F64) -> tuple[F64, NDArray[np.int64]]:
    """(N, 3) unit directions in the body's axes, and which of them each frame (T,) has.

    What rests keeps its turn to the bit, and shares one.
    """
    many = max(len(mover), len(direction))
    turn = np.broadcast_to(mover.orientation, (many, 4))
    new = np.ones(many, np.bool_)
    new[1:] = (turn[1:] != turn[:-1]).any(1)
    if len(direction) > 1:
        new[1:] |= (direction[1:] != direction[:-1]).any(1)
    at = np.flatnonzero(new)
    d = np.broadcast_to(direction, (many, 3))[at]
    return (matrix(turn[at]) * d[:, :, None]).sum(1), np.cumsum(new) - 1


def _times(vectors: F64, matrix: F64) -> F64:
    """(N, 3) products, each the same to the bit whatever the others are."""
    return np.asarray(np.einsum("nk,kj->nj", vectors, matrix))


def _face_middle(solids: Solids, g: int, d: F64) -> F64:
    """(N, 3) of geom g, in its axes: its farthest point along d (N, 3), or a face's middle."""
    kind, size, radius = solids.kind[g], solids.size[g], solids.radius[g]
    if kind == HULL:
        vertices, out = solids.corners[g].points, np.empty((len(d), 3))
        along = d @ vertices.T
        for row, near in enumerate(along >= along.max(1, keepdims=True) - FLAT * radius):
            out[row] = (vertices[near].min(0) + vertices[near].max(0)) / 2
        return out
    if kind == ELLIPSOID:
        return np.asarray(size**2 * d / np.sqrt(((size * d) ** 2).sum(1, keepdims=True)))
    out = np.where(np.abs(d) < FLAT, 0.0, np.where(d < 0, -size, size))
    if kind == CYLINDER:
        radial = np.hypot(d[:, :1], d[:, 1:2])
        out[:, :2] = np.where(radial < FLAT, 0.0, size[0] * d[:, :2] / np.maximum(radial, FLAT))
    return np.asarray(out + solids.margin[g] * d)
