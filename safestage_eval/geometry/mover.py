"""A shape and its poses over time, and how far its points move."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .pose import angle, matrix, transform, unit
from .shape import BodyShape

F64 = NDArray[np.float64]
Frames = NDArray[np.integer]

ROUNDING = 1.0 + 1e-9
"""Motion bounds are stretched by this, so that rounding never makes them too short."""


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
    def turn(self) -> F64:
        """(T, 4) unit quaternions. Raises ValueError where one has norm 0 or is not finite."""
        try:
            return unit(self.orientation)
        except ValueError as error:
            raise ValueError(
                f"an orientation of {self.shape.name!r} has norm 0 or is not finite"
            ) from error

    @cached_property
    def centre(self) -> F64:
        """(T, 3) m, the shape's bounding centre, world."""
        if self.shape.centre.any():
            return transform(self.position, self.turn, self.shape.centre)
        return np.asarray(self.position, np.float64)

    @cached_property
    def steps(self) -> F64:
        """(T − 1,) m: how far any point of the body goes, at most, from each frame to the next.

        Takes the way between two frames to be straight for the bounding centre and an even turn
        by the smaller angle.
        """
        turn = angle(self.orientation[1:], self.orientation[:-1])
        way = np.sqrt((np.diff(self.centre, axis=0) ** 2).sum(1))
        np.multiply(turn, self.shape.radius, out=turn, where=turn > 0)
        return np.asarray(way + turn)

    def chord(self, frames: Frames, others: Frames) -> F64:
        """(N,) m, how far any point of the body at one frame is at most from where it is at another."""
        if len(self) == 1:
            return np.zeros(len(frames))
        way = self.centre[frames] - self.centre[others]
        p, q = self.turn[frames], self.turn[others]
        # |R u − S u| over unit vectors u is 2 sin(θ/2), and no more than 2 min ‖p ∓ q‖
        turn = 2 * np.sqrt(np.minimum(((p - q) ** 2).sum(1), ((p + q) ** 2).sum(1)))
        np.multiply(turn, self.shape.radius, out=turn, where=turn > 0)
        return np.asarray((np.sqrt((way * way).sum(1)) + turn) * ROUNDING)

    def at(self, frames: Frames | slice) -> Mover:
        """Select some frames; a body that never moves stays as it is."""
        if len(self) == 1:
            return self
        return Mover(self.shape, self.position[frames], self.orientation[frames])

    def rows(self, frames: Frames) -> Frames:
        """Where the poses of some frames are; a body that never moves has one."""
        return frames if len(self) > 1 else np.zeros_like(frames)


def frame_count(*movers: Mover) -> int:
    """T of several movers together: their common length, where those of length 1 do not count.

    Raises ValueError when two lengths contradict each other.
    """
    lengths = {len(mover) for mover in movers} - {1}
    if len(lengths) > 1:
        raise ValueError(f"movers of different lengths: {sorted(lengths)}")
    return lengths.pop() if lengths else 1


def placed(mover: Mover, frames: Frames, points: F64) -> F64:
    """(N, V, 3) m, world: points (V, 3) of a body's frame at some frames (N,)."""
    some = mover.at(frames)
    out = points @ matrix(some.orientation).swapaxes(1, 2) + some.position[:, None]
    return np.broadcast_to(out, (len(frames), *out.shape[1:]))
