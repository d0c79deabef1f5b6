"""Extent of a body: its lowest and highest point, its reach in any direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval._process.compiled import allocating, helper

from .arrays import owned
from .mover import Motion, Mover, rotation_at
from .shape import BOX, CYLINDER, HULL, PLANE, SEGMENT, Packed
from .support_function import support_point, support_value

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
    out = np.full(max(len(mover), len(d)), -np.inf)
    _reach(mover.shape.hulls, mover.motion, owned(d / norm), out)
    return out


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
    d = d / np.sqrt((d * d).sum(1, keepdims=True))
    out = np.full((max(len(mover), len(d)), 3), np.nan)
    _farthest(mover.shape.hulls, mover.motion, owned(d), out)
    return out


@helper
def _to_geom(geoms: Packed, g: int, body: F64, out: F64) -> None:
    """Direction (3,) in body axes, in the axes of geom g."""
    for i in range(3):
        out[i] = (
            geoms.rotation[g, 0, i] * body[0]
            + geoms.rotation[g, 1, i] * body[1]
            + geoms.rotation[g, 2, i] * body[2]
        )


@helper
def _to_body(rotation: F64, direction: F64, row: int, out: F64) -> None:
    """Row of directions (N, 3), world, in the axes of a body with this rotation."""
    for i in range(3):
        out[i] = (
            rotation[0, i] * direction[row, 0]
            + rotation[1, i] * direction[row, 1]
            + rotation[2, i] * direction[row, 2]
        )


@allocating
def _reach(geoms: Packed, motion: Motion, direction: F64, out: F64) -> None:
    rotation, body, local, point = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    last, last_direction = motion.centre.shape[0] - 1, direction.shape[0] - 1
    best = -np.inf
    for t in range(out.shape[0]):
        s, row = min(t, last), min(t, last_direction)
        turned = t in (0, row)
        for i in range(4):
            turned |= motion.orientation[s, i] != motion.orientation[max(s, 1) - 1, i]
        if turned:  # what rests keeps its turn to the bit
            rotation_at(motion.orientation, s, rotation)
            _to_body(rotation, direction, row, body)
            best = -np.inf
            for g in range(geoms.kind.shape[0]):
                _to_geom(geoms, g, body, local)
                value = support_value(geoms, g, local[0], local[1], local[2], point)
                for i in range(3):
                    value += body[i] * geoms.offset[g, i]
                best = max(best, value)
        out[t] = best
        for i in range(3):
            out[t] += motion.centre[s, i] * direction[row, i]


@helper
def _face_middle(geoms: Packed, g: int, d: F64, box: F64, out: F64) -> None:
    """Like ``support_point``, margin included, but the middle of a face that looks along d (3,).

    ``box`` (2, 3) is scratch.
    """
    support_point(geoms, g, d[0], d[1], d[2], out)
    kind = geoms.kind[g]
    if kind in (BOX, SEGMENT):
        for i in range(3):
            if abs(d[i]) < FLAT:
                out[i] = 0.0
    elif kind == CYLINDER:
        if d[0] * d[0] + d[1] * d[1] < FLAT * FLAT:
            out[0], out[1] = 0.0, 0.0
        if abs(d[2]) < FLAT:
            out[2] = 0.0
    elif kind == HULL:
        best = out[0] * d[0] + out[1] * d[1] + out[2] * d[2]
        for i in range(3):
            box[0, i], box[1, i] = np.inf, -np.inf
        for v in range(geoms.first[g], geoms.first[g] + geoms.points[g]):
            p = geoms.vertices[v]
            if p[0] * d[0] + p[1] * d[1] + p[2] * d[2] >= best - FLAT * geoms.radius[g]:
                for i in range(3):
                    box[0, i], box[1, i] = min(box[0, i], p[i]), max(box[1, i], p[i])
        for i in range(3):
            out[i] = (box[0, i] + box[1, i]) / 2
    for i in range(3):
        out[i] += geoms.margin[g] * d[i]


@allocating
def _farthest(geoms: Packed, motion: Motion, direction: F64, out: F64) -> None:
    rotation, body, local = np.empty((3, 3)), np.empty(3), np.empty(3)
    point, place, box = np.empty(3), np.empty(3), np.empty((2, 3))
    last, last_direction = motion.centre.shape[0] - 1, direction.shape[0] - 1
    for t in range(out.shape[0]):
        s, row = min(t, last), min(t, last_direction)
        rotation_at(motion.orientation, s, rotation)
        _to_body(rotation, direction, row, body)
        best = -np.inf
        for g in range(geoms.kind.shape[0]):
            if geoms.kind[g] == PLANE:
                continue
            _to_geom(geoms, g, body, local)
            _face_middle(geoms, g, local, box, point)
            value = 0.0
            for i in range(3):
                place[i] = geoms.offset[g, i]
                for j in range(3):
                    place[i] += geoms.rotation[g, i, j] * point[j]
                value += body[i] * place[i]
            if value > best:
                best = value
                for i in range(3):
                    out[t, i] = motion.centre[s, i]
                    for j in range(3):
                        out[t, i] += rotation[i, j] * place[j]
