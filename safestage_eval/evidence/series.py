"""A physical quantity per frame, with its unit and with what is not known about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Series:
    """An interval per frame that contains the true value.

    Attributes:
        lower, upper: (T,) SI; equal where the value is known. Where nothing is known they are
            −∞ and +∞. A clearance capped at 10 cm is [0.1, +∞) where the bodies are further apart.
        dimension: as in ``units.DIMENSIONS``.
        notes: remarks for the reader of a verdict based on this series.
    """

    lower: F64
    upper: F64
    dimension: str
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """T."""
        return len(self.lower)

    def at(self, frame: int) -> Series:
        """That frame alone."""
        here = slice(frame, frame + 1)
        return Series(self.lower[here], self.upper[here], self.dimension, self.notes)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(T,) false where nothing is known at all."""
        return ~(np.isneginf(self.lower) & np.isposinf(self.upper))

    @property
    def value(self) -> F64:
        """(T,) SI: the finite end nearer to certainty (upper, else lower); NaN where unknown."""
        best = np.where(np.isfinite(self.upper), self.upper, self.lower)
        return np.where(self.known, best, np.nan)


def exact(values: ArrayLike, dimension: str, notes: tuple[str, ...] = ()) -> Series:
    """A series known at every frame."""
    array = np.asarray(values, np.float64)
    return Series(array, array, dimension, notes)


def hide(found: Series, where: NDArray[np.bool_]) -> Series:
    """Return the series, unknown where ``where`` (T,) is true."""
    lower, upper = np.where(where, -np.inf, found.lower), np.where(where, np.inf, found.upper)
    return Series(lower, upper, found.dimension, found.notes)


def unknown(frames: int, dimension: str, why: str) -> Series:
    """A series of which nothing is known, and why."""
    return Series(np.full(frames, -np.inf), np.full(frames, np.inf), dimension, (why,))


def hidden(found: Series, lost: NDArray[np.bool_], note: str) -> Series:
    """Return the series, unknown where ``lost`` (T,) is true, with a note that says so."""
    if not lost.any():
        return found
    return replace(hide(found, lost), notes=(*found.notes, note))
