"""Reference of a change: the baseline, or an event."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.pose import mean_orientation

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Baseline:
    """The first frames of the episode, over which the initial state is estimated.

    Median position and mean orientation over the first five frames reduce initialisation noise.
    Frames behind a hole do not count.
    """

    frames: int = 5
    start: int = 0
    """The first of them: 0 but for a body that settles first. Before it, nothing counts as moved."""
    notes: tuple[str, ...] = ()
    """Notes on the reference, for the reader of a change measured from it."""
    asked: int = 5
    """How many frames there would be without a hole."""

    @property
    def stretch(self) -> slice:
        """These frames."""
        return slice(self.start, self.start + self.frames)

    def position(self, values: F64) -> F64:
        """(T, 3) → (3,) m: the spatial median over the baseline frames, as a medoid.

        The frame whose summed distance to the others is least. One wild frame does not move it,
        and unlike the median of each coordinate it does not depend on how the world's axes lie.
        """
        some = values[self.stretch]
        between = some[:, None] - some[None]
        apart = np.sqrt(np.add.reduce(between * between, axis=2)).sum(axis=0)
        medoid: F64 = some[int(np.argmin(apart))]
        return medoid

    def orientation(self, quaternions: NDArray[np.floating]) -> F64:
        """(T, 4) wxyz → (4,): the mean over the baseline frames."""
        return mean_orientation(quaternions[self.stretch])


@dataclass(frozen=True, eq=False)
class Reference:
    """Where each frame looks back to.

    Attributes:
        baseline: used where ``since`` is −1.
        since: (T,) frame of the latest event at or before each frame, −1 if there was none yet;
            None to refer to the baseline throughout.
        key: identifies it among the references of one episode.
    """

    baseline: Baseline
    since: NDArray[np.int64] | None = None
    key: str = ""

    def of(self, values: NDArray[np.floating], initial: F64) -> F64:
        """The reference value at each frame: (T, k) values and (k,) baseline value → (T, k)."""
        start = self.baseline.start
        if self.since is None or not len(self.since) or self.since[-1] < 0:  # no event at all
            there = np.broadcast_to(initial, values.shape)
            return np.concatenate([values[:start], there[start:]]) if start else there
        picked = np.take(values, self.since, axis=0, mode="clip").astype(np.float64)
        first = int(np.argmax(self.since >= 0))
        picked[:first] = initial
        picked[: min(start, first)] = values[: min(start, first)]
        return picked


def latest(instants: NDArray[np.int64], frames: int) -> NDArray[np.int64]:
    """(T,) frame of the latest instant at or before each frame, −1 where there is none yet."""
    since = np.full(frames, -1, np.int64)
    since[instants] = instants
    return np.maximum.accumulate(since)
