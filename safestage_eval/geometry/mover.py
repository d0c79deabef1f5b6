"""A shape and its poses over time, prepared for the kernels once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval._process.compiled import allocating, helper

from .arrays import owned
from .pose import angle as turn_angle
from .shape import BodyShape

F64 = NDArray[np.float64]

BLOCK = 64
"""Frames per swept box."""

ROUNDING = 1.0 + 1e-9
"""Motion bounds are stretched by this, so that rounding never makes them too short."""


class Motion(NamedTuple):
    """The poses of a body as the kernels read them; K = ceil(T / BLOCK).

    Attributes:
        centre: (T, 3) m, the shape's bounding centre, world.
        orientation: (T, 4) unit, wxyz, body frame to world.
        path: (T,) m, cumulative bound on how far any point of the body has moved since frame 0,
            by chords: |d(t) − d(s)| of any distance is at most path[t] − path[s].
        low, high: (K, 3) m, corners of a box that holds the bounding centre during a block.
        extent: (K, 3) m, half lengths of a world-aligned box around the bounding centre that
            holds the body at every frame of the block.
    """

    centre: F64
    orientation: F64
    path: F64
    low: F64
    high: F64
    extent: F64


@dataclass(frozen=True, eq=False)
class Mover:
    """A body's shape along its poses.

    Attributes:
        shape: what moves.
        position: (T, 3) m, body frame's origin, world; T = 1 for a body that never moves.
        orientation: (T, 4) wxyz, body frame to world, unit norm to within float32 rounding.
    """

    shape: BodyShape
    position: NDArray[np.floating]
    orientation: NDArray[np.floating]

    @classmethod
    def build(cls, shape: BodyShape, position: ArrayLike, orientation: ArrayLike) -> Mover:
        """Accept one pose, (3,) and (4,), or T; raises ValueError when their lengths differ."""
        p = np.atleast_2d(np.asarray(position))
        q = np.atleast_2d(np.asarray(orientation))
        if p.shape[1:] != (3,) or q.shape[1:] != (4,) or len(p) != len(q):
            raise ValueError(f"poses of {shape.name!r} have shapes {p.shape} and {q.shape}")
        return cls(shape, p, q)

    def __len__(self) -> int:
        """T."""
        return len(self.position)

    @cached_property
    def motion(self) -> Motion:
        """Poses as the kernels read them; computed on first use and kept.

        Raises ValueError where an orientation is no rotation (norm 0 or not finite).
        """
        frames = len(self)
        blocks = -(-frames // BLOCK)
        motion = Motion(
            owned(self.position),
            owned(self.orientation),
            np.zeros(frames),
            np.empty((blocks, 3)),
            np.empty((blocks, 3)),
            np.empty((blocks, 3)),
        )
        shape = self.shape
        if not _prepare(motion, owned(shape.centre), owned(shape.half), float(shape.radius)):
            raise ValueError(f"an orientation of {shape.name!r} has norm 0 or is not finite")
        return motion

    @cached_property
    def steps(self) -> F64:
        """(T − 1,) m: how far any point of the body goes, at most, from each frame to the next.

        Takes the way between two frames to be straight for the bounding centre and an even turn
        by the smaller angle.
        """
        turn = turn_angle(self.orientation[1:], self.orientation[:-1])
        way = np.sqrt((np.diff(self.motion.centre, axis=0) ** 2).sum(1))
        np.multiply(turn, self.shape.radius, out=turn, where=turn > 0)
        return np.asarray(way + turn)

    def at(self, frames: NDArray[np.integer] | slice) -> Mover:
        """Select some frames; a body that never moves stays as it is."""
        if len(self) == 1:
            return self
        return Mover(self.shape, self.position[frames], self.orientation[frames])


def frame_count(*movers: Mover) -> int:
    """T of several movers together: their common length, where those of length 1 do not count.

    Raises ValueError when two lengths contradict each other.
    """
    lengths = {len(mover) for mover in movers} - {1}
    if len(lengths) > 1:
        raise ValueError(f"movers of different lengths: {sorted(lengths)}")
    return lengths.pop() if lengths else 1


@helper
def rotation_at(orientation: F64, t: int, out: F64) -> None:
    """Write the (3, 3) rotation matrix of row t of unit quaternions (T, 4) into ``out``."""
    w, x, y, z = orientation[t, 0], orientation[t, 1], orientation[t, 2], orientation[t, 3]
    out[0, 0] = 1 - 2 * (y * y + z * z)
    out[0, 1] = 2 * (x * y - z * w)
    out[0, 2] = 2 * (x * z + y * w)
    out[1, 0] = 2 * (x * y + z * w)
    out[1, 1] = 1 - 2 * (x * x + z * z)
    out[1, 2] = 2 * (y * z - x * w)
    out[2, 0] = 2 * (x * z - y * w)
    out[2, 1] = 2 * (y * z + x * w)
    out[2, 2] = 1 - 2 * (x * x + y * y)


@helper
def _turn_chord(orientation: F64, t: int, s: int) -> float:
    """Upper bound on |R(t)u − R(s)u| over unit vectors u: 2 sin(θ/2) ≤ 2 min‖q∓q′‖."""
    minus, plus = 0.0, 0.0
    for i in range(4):
        p, q = orientation[t, i], orientation[s, i]
        minus += (p - q) * (p - q)
        plus += (p + q) * (p + q)
    return 2.0 * math.sqrt(min(minus, plus))


@helper
def chord(motion: Motion, radius: float, t: int, s: int) -> float:
    """Upper bound (m) on how far any point of the body is displaced between frames s and t."""
    return _displaced(motion, radius, t, s, _turn_chord(motion.orientation, t, s))


@helper
def _displaced(motion: Motion, radius: float, t: int, s: int, turn: float) -> float:
    """Like ``chord``, where the ``_turn_chord`` between the frames is known."""
    dx = motion.centre[t, 0] - motion.centre[s, 0]
    dy = motion.centre[t, 1] - motion.centre[s, 1]
    dz = motion.centre[t, 2] - motion.centre[s, 2]
    move = math.sqrt(dx * dx + dy * dy + dz * dz)
    return (move + radius * turn if turn > 0.0 else move) * ROUNDING


@allocating
def _prepare(motion: Motion, centre: F64, half: F64, radius: float) -> bool:
    """Fill a Motion with the body's positions as ``centre`` and its raw quaternions.

    False where a quaternion cannot be normalised.
    """
    frames = motion.centre.shape[0]
    rotation = np.empty((3, 3))
    shifted = centre[0] != 0.0 or centre[1] != 0.0 or centre[2] != 0.0
    turned = 0.0
    for t in range(frames):
        k = t // BLOCK
        first = t % BLOCK == 0
        square = 0.0
        for i in range(4):
            square += motion.orientation[t, i] * motion.orientation[t, i]
        if not 0.0 < square < np.inf:
            return False
        norm = math.sqrt(square)
        for i in range(4):
            motion.orientation[t, i] /= norm
        if shifted or first:
            rotation_at(motion.orientation, t, rotation)
        for i in range(3):
            if shifted:
                motion.centre[t, i] += (
                    rotation[i, 0] * centre[0]
                    + rotation[i, 1] * centre[1]
                    + rotation[i, 2] * centre[2]
                )
            c = motion.centre[t, i]
            motion.low[k, i] = c if first else min(motion.low[k, i], c)
            motion.high[k, i] = c if first else max(motion.high[k, i], c)
        turn = _turn_chord(motion.orientation, t, t - 1) if t > 0 else 0.0
        if t > 0:
            motion.path[t] = motion.path[t - 1] + _displaced(motion, radius, t, t - 1, turn)
        if first:
            turned = 0.0
            for i in range(3):
                e = 0.0
                for j in range(3):
                    e += abs(rotation[i, j]) * half[j] if rotation[i, j] != 0.0 else 0.0
                motion.extent[k, i] = e
        else:
            turned += turn
        if t % BLOCK == BLOCK - 1 or t == frames - 1:
            for i in range(3):
                wider = (
                    motion.extent[k, i] + radius * turned if turned > 0.0 else motion.extent[k, i]
                )
                motion.extent[k, i] = min(wider, radius) * ROUNDING
    return True
