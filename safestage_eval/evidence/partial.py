"""A signal that is measured at some frames only, each at most once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .intervals import Interval

Bool = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Partial:
    """Bounds (T,), which frames are done (T,), and what was noted.

    Attributes:
        lower, upper: unknown where it is not measured yet.
        done: where it is.
        notes: note → (T,) the frames that it is about.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    done: Bool
    notes: dict[str, Bool]

    @classmethod
    def blank(cls, frames: int) -> Partial:
        """Nothing measured yet."""
        return cls(
            np.full(frames, -np.inf), np.full(frames, np.inf), np.zeros(frames, np.bool_), {}
        )

    def missing(self, wanted: Bool) -> NDArray[np.int64]:
        """The wanted frames (T,) that are still to be measured."""
        return np.flatnonzero(wanted & ~self.done)

    def add(self, at: NDArray[np.int64], found: Interval) -> None:
        """Measurements at N frames, with a note on those that are unknown, if any."""
        self.lower[at], self.upper[at] = found.lower, found.upper
        self.done[at] = True
        vague = np.isneginf(found.lower) & np.isposinf(found.upper)
        for note in found.notes:
            about = self.notes.setdefault(note, np.zeros(len(self.done), np.bool_))
            about[at[vague] if vague.any() else at] = True

    def series(self, wanted: Bool, dimension: str) -> Interval:
        """All that is known, with the notes about the wanted frames (T,)."""
        notes = tuple(note for note, about in self.notes.items() if (about & wanted).any())
        return Interval(self.lower, self.upper, dimension, notes)
