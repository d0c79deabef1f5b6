"""The one form of an uncertain value: an interval per frame, of a measurement or of a margin.

A margin is >= 0 where a condition holds and < 0 where it does not: certainly true where lower >= 0,
certainly false where upper < 0, unknown between. And is min, or is max, not is negation; all of them act
on both ends alike (quantitative semantics of temporal logic: Donzé & Maler, "Robust satisfaction of
temporal logic over real-valued signals", 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

TINY = float(np.nextafter(0.0, 1.0))
"""The least size of a margin: just true, or negated just false."""


@dataclass(frozen=True, eq=False, slots=True)
class Interval:
    """An interval per frame that contains the true value.

    Attributes:
        lower, upper: (T,) SI; equal where the value is known. Where nothing is known they are
            −∞ and +∞. A clearance capped at 10 cm is [0.1, +∞) where the bodies are further apart.
        dimension: as in ``units.DIMENSIONS``; "number" for margins, too.
        notes: remarks for the reader of a verdict that is based on it.
    """

    lower: F64
    upper: F64
    dimension: str = "number"
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """T."""
        return len(self.lower)

    def between(self, first: int, stop: int) -> Interval:
        """The frames [first, stop)."""
        if first == 0 and stop >= len(self.lower):
            return self
        lower = self.lower[first:stop]
        upper = lower if self.exact else self.upper[first:stop]
        return replace(self, lower=lower, upper=upper)

    def at(self, frame: int) -> Interval:
        """That frame alone."""
        return self.between(frame, frame + 1)

    @property
    def exact(self) -> bool:
        """Both ends are one array: what is done to the one need not be done to the other."""
        return self.lower is self.upper

    # ---- as a measurement

    @property
    def known(self) -> Bool:
        """(T,) false where nothing is known at all."""
        return ~(np.isneginf(self.lower) & np.isposinf(self.upper))

    @property
    def any_known(self) -> bool:
        """Whether an end is finite at some frame."""
        if len(self.lower) and (self.lower[0] > -np.inf or self.upper[0] < np.inf):
            return True
        return not ((self.lower == -np.inf).all() and (self.upper == np.inf).all())

    @property
    def value(self) -> F64:
        """(T,) SI: the finite end nearer to certainty (upper, else lower); NaN where unknown."""
        best = np.where(np.isfinite(self.upper), self.upper, self.lower)
        return np.where(self.known, best, np.nan)

    # ---- as a margin

    @property
    def true(self) -> Bool:
        """(T,) certainly true."""
        return self.lower >= 0

    @property
    def false(self) -> Bool:
        """(T,) certainly false."""
        return self.upper < 0

    @property
    def possible(self) -> Bool:
        """(T,) not certainly false."""
        return ~(self.upper < 0)

    @property
    def unknown(self) -> Bool:
        """(T,) neither."""
        return (self.lower < 0) & (self.upper >= 0)

    @property
    def decided(self) -> bool:
        """Whether it holds is known at every frame."""
        return self.exact or not self.unknown.any()


def exact(values: ArrayLike, dimension: str, notes: tuple[str, ...] = ()) -> Interval:
    """An interval that is known at every frame."""
    array = np.asarray(values, np.float64)
    return Interval(array, array, dimension, notes)


def unknown(frames: int, dimension: str, why: str) -> Interval:
    """An interval of which nothing is known, with the reason as its note."""
    return Interval(np.full(frames, -np.inf), np.full(frames, np.inf), dimension, (why,))


def hide(found: Interval, where: Bool) -> Interval:
    """Return the same, unknown where ``where`` (T,) is true."""
    lower, upper = np.where(where, -np.inf, found.lower), np.where(where, np.inf, found.upper)
    return replace(found, lower=lower, upper=upper)


def hidden(found: Interval, lost: Bool, note: str) -> Interval:
    """Return the same, unknown where ``lost`` (T,) is true, with a note that says so."""
    if not lost.any():
        return found
    return replace(hide(found, lost), notes=(*found.notes, note))


def each(function: Callable[..., F64], *margins: Interval) -> Interval:
    """A function of margins applied to the lower ends, and to the upper ends if they differ."""
    lower = function(*[m.lower for m in margins])
    for m in margins:
        if m.lower is not m.upper:
            return Interval(lower, function(*[m.upper for m in margins]))
    return Interval(lower, lower)


def negated(margin: F64) -> F64:
    """The margin of the opposite: where it was exactly 0 (true), the opposite is just false."""
    return strict(np.asarray(-margin))


def strict(margin: F64) -> F64:
    """Make margins of exactly 0 just false, in place; returns the array."""
    at_limit = margin == 0
    if at_limit.any():
        margin[at_limit] = -TINY
    return margin


def crisp(sure: Bool, possible: Bool | None = None) -> Interval:
    """±∞ margins of a yes-or-no series (T,); [−∞, +∞] where it is ``possible`` but not ``sure``."""
    lower = np.where(sure, np.inf, -np.inf)
    if possible is None or np.array_equal(sure, possible):
        return Interval(lower, lower)
    return Interval(lower, np.where(possible, np.inf, -np.inf))


def both(bands: Sequence[Interval], frames: int) -> Interval:
    """All hold; over no bands at all, true."""
    if not bands:
        return crisp(np.ones(frames, np.bool_))
    if len(bands) == 1:
        return bands[0]
    return _reduced(np.minimum, bands)


def either(bands: Sequence[Interval], frames: int) -> Interval:
    """At least one holds; over no bands at all, false."""
    if not bands:
        return crisp(np.zeros(frames, np.bool_))
    if len(bands) == 1:
        return bands[0]
    return _reduced(np.maximum, bands)


def _reduced(extreme: np.ufunc, bands: Sequence[Interval]) -> Interval:
    """The least or the greatest of two margins or more."""
    first, second, *more = bands
    lower = extreme(first.lower, second.lower)
    exact = first.lower is first.upper and second.lower is second.upper
    for band in more:
        extreme(lower, band.lower, out=lower)
        exact = exact and band.lower is band.upper
    if exact:
        return Interval(lower, lower)
    upper = extreme(first.upper, second.upper)
    for band in more:
        extreme(upper, band.upper, out=upper)
    return Interval(lower, upper)


def opposite(band: Interval) -> Interval:
    """It does not hold."""
    lower = negated(band.upper)
    return Interval(lower, lower if band.exact else negated(band.lower))


def at_least(count: int, bands: Sequence[Interval], frames: int) -> Interval:
    """At least ``count`` of the bands hold: the count-th largest margin."""
    if count <= 0:
        return crisp(np.ones(frames, np.bool_))
    if count > len(bands):
        return crisp(np.zeros(frames, np.bool_))
    return each(lambda *margins: np.sort(margins, axis=0)[-count], *bands)
