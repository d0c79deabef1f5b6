"""A margin per frame, known up to an interval: three-valued truth with a distance to it.

A margin is >= 0 where a condition holds and < 0 where it does not. What is not known exactly is
an interval [lower, upper]: certainly true where lower >= 0, certainly false where upper < 0,
unknown between. And is min, or is max, not is negation; all of them act on both ends alike
(quantitative semantics of temporal logic: Donzé & Maler, "Robust satisfaction of temporal logic
over real-valued signals", 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

TINY = float(np.nextafter(0.0, 1.0))
"""The least size of a margin: just true, or negated just false."""


class Band(NamedTuple):
    """Lower and upper margin, each (T,), dimensionless."""

    lower: F64
    upper: F64

    @property
    def true(self) -> Bool:
        """(T,) certainly true."""
        return self.lower >= 0

    @property
    def false(self) -> Bool:
        """(T,) certainly false."""
        return self.upper < 0

    @property
    def unknown(self) -> Bool:
        """(T,) neither."""
        return (self.lower < 0) & (self.upper >= 0)

    @property
    def exact(self) -> bool:
        """Both ends are one array: what is done to the one need not be done to the other."""
        return self.lower is self.upper

    @property
    def any_known(self) -> bool:
        """Whether an end is finite at some frame."""
        if len(self.lower) and (self.lower[0] > -np.inf or self.upper[0] < np.inf):
            return True
        return not ((self.lower == -np.inf).all() and (self.upper == np.inf).all())

    def at(self, first: int, stop: int) -> Band:
        """The frames [first, stop)."""
        if first == 0 and stop >= len(self.lower):
            return self
        lower = self.lower[first:stop]
        return Band(lower, lower if self.exact else self.upper[first:stop])


def each(function: Callable[..., F64], *bands: Band) -> Band:
    """A function of margins applied to the lower ends, and to the upper ends if they differ."""
    lower = function(*[b.lower for b in bands])
    for b in bands:
        if b.lower is not b.upper:
            return Band(lower, function(*[b.upper for b in bands]))
    return Band(lower, lower)


def negated(margin: F64) -> F64:
    """The margin of the opposite: where it was exactly 0 (true), the opposite is just false."""
    return strict(np.asarray(-margin))


def strict(margin: F64) -> F64:
    """Make margins of exactly 0 just false, in place; returns the array."""
    at_limit = margin == 0
    if at_limit.any():
        margin[at_limit] = -TINY
    return margin


def crisp(truth: Bool, known: Bool | None = None) -> Band:
    """±∞ margins of a yes-or-no series (T,); where ``known`` is false, [−∞, +∞]."""
    margin = np.where(truth, np.inf, -np.inf)
    if known is None or known.all():
        return Band(margin, margin)
    return Band(np.where(known, margin, -np.inf), np.where(known, margin, np.inf))


def both(bands: Sequence[Band], frames: int) -> Band:
    """All hold; over no bands at all, true."""
    if not bands:
        return crisp(np.ones(frames, np.bool_))
    if len(bands) == 1:
        return bands[0]
    return _reduced(np.minimum, bands)


def either(bands: Sequence[Band], frames: int) -> Band:
    """At least one holds; over no bands at all, false."""
    if not bands:
        return crisp(np.zeros(frames, np.bool_))
    if len(bands) == 1:
        return bands[0]
    return _reduced(np.maximum, bands)


def _reduced(extreme: np.ufunc, bands: Sequence[Band]) -> Band:
    """The least or the greatest of two margins or more."""
    first, second, *more = bands
    lower = extreme(first.lower, second.lower)
    exact = first.lower is first.upper and second.lower is second.upper
    for band in more:
        extreme(lower, band.lower, out=lower)
        exact = exact and band.lower is band.upper
    if exact:
        return Band(lower, lower)
    upper = extreme(first.upper, second.upper)
    for band in more:
        extreme(upper, band.upper, out=upper)
    return Band(lower, upper)


def opposite(band: Band) -> Band:
    """It does not hold."""
    lower = negated(band.upper)
    return Band(lower, lower if band.exact else negated(band.lower))


def at_least(count: int, bands: Sequence[Band], frames: int) -> Band:
    """At least ``count`` of the bands hold: the count-th largest margin."""
    if count <= 0:
        return crisp(np.ones(frames, np.bool_))
    if count > len(bands):
        return crisp(np.zeros(frames, np.bool_))
    return each(lambda *margins: np.sort(margins, axis=0)[-count], *bands)
