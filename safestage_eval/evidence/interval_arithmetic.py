"""Arithmetic with series that are known up to an interval: every value that may be, and no more.

Where an end is not finite, so is that of the result; 0 times it is 0, for what is not known is some
number. Nothing is lost where a signal stands in an operation once; where it stands twice
(``a − a``), the interval is wider than it need be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from .intervals import Interval

F64 = NDArray[np.float64]
Ends = tuple[F64, F64]


def combined(operation: str, operands: Sequence[Interval]) -> Ends:
    """Lower and upper end (T,) of a pointwise operation; one array where all operands are exact.

    ``operation``: ``difference``, ``product``, ``magnitude`` or ``abs``.
    """
    ends = [(one.lower, one.upper) for one in operands]
    with np.errstate(invalid="ignore", over="ignore"):
        if operation == "difference":
            (a, b), (c, d) = ends
            return _known(lambda x, y: x - y, (a, d), (b, c))
        if operation == "abs":
            return _size(ends[0])
        if operation == "magnitude":
            squares = [_squared(_size(end)) for end in ends]
            low, high = reduce(_sum, squares)
            root = np.sqrt(low)
            return root, root if high is low else np.sqrt(high)
        return reduce(_times, ends)


def change_per_second(of: Interval, t: F64) -> Ends:
    """Ends (T,) of the change since the sample before, per second; the first as the second.

    A single sample tells of no change.
    """
    if len(t) < 2:
        return np.full(len(t), -np.inf), np.full(len(t), np.inf)
    seconds = np.diff(t)
    with np.errstate(invalid="ignore"):
        low = (of.lower[1:] - of.upper[:-1]) / seconds
        high = (of.upper[1:] - of.lower[:-1]) / seconds
    lower = np.where(np.isnan(low), -np.inf, low)
    lower = np.append(lower[:1], lower)
    if of.lower is of.upper and np.isfinite(lower).all():
        return lower, lower
    upper = np.where(np.isnan(high), np.inf, high)
    return lower, np.append(upper[:1], upper)


def change_within(of: Interval, t: F64, before: float, after: float) -> Ends:
    """Ends (T,) of the mean change per second, from up to ``before`` s ahead of each to ``after`` s behind.

    At both ends of the recording the time is cut short there. It is not known where something
    within it is not, and where samples lie further apart, so that none is in reach.
    """
    frames = len(t)
    k = np.arange(frames)
    first = np.searchsorted(t, t - before * (1 + 1e-6), "left")
    last = np.searchsorted(t, t + after * (1 + 1e-6), "right") - 1
    seconds = t[last] - t[first]
    lost = np.cumsum(np.append(0, ~(np.isfinite(of.lower) & np.isfinite(of.upper))))
    open_ = (first == last) | (lost[last + 1] > lost[first])
    if before:
        open_ |= (first == k) & (k > 0)
    if after:
        open_ |= (last == k) & (k < frames - 1)
    seconds = np.where(first == last, 1.0, seconds)
    with np.errstate(invalid="ignore"):
        lower = np.where(open_, -np.inf, (of.lower[last] - of.upper[first]) / seconds)
        if of.lower is of.upper and not open_.any():
            return lower, lower
        return lower, np.where(open_, np.inf, (of.upper[last] - of.lower[first]) / seconds)


def change_since(of: Interval, since: NDArray[np.int64]) -> Ends:
    """Ends (T,) of the change since a frame (T,) each; since the first one where it is −1."""
    there = np.maximum(since, 0)
    now, then = (of.lower, of.upper), (of.lower[there], of.upper[there])
    if of.lower is of.upper:
        then = then[0], then[0]
    with np.errstate(invalid="ignore"):
        return _known(lambda x, y: x - y, (now[0], then[1]), (now[1], then[0]))


def summed_over_time(of: Interval, t: F64) -> Ends:
    """Ends (T,) of what it adds up to since the first sample, each value times the time before it."""
    seconds = np.diff(t, prepend=t[:1])
    low = _running(of.lower, seconds, -np.inf)
    return low, low if of.upper is of.lower else _running(of.upper, seconds, np.inf)


def _running(end: F64, seconds: F64, lost: float) -> F64:
    """(T,) the running sum; once it is not known, it stays so."""
    with np.errstate(invalid="ignore"):
        parts = np.where(seconds == 0, 0.0, end * seconds)
        total = np.cumsum(parts)
    bad = np.logical_or.accumulate(~np.isfinite(parts))
    return np.where(bad, lost, total)


def _known(of: Callable[[F64, F64], F64], low: Ends, high: Ends) -> Ends:
    """A lower end of ``of(*low)`` and an upper one of ``of(*high)``; ∞ − ∞ may be anything."""
    lower = of(*low)
    lower = np.where(np.isnan(lower), -np.inf, lower)
    if low[0] is high[0] and low[1] is high[1]:
        return lower, lower
    upper = of(*high)
    return lower, np.where(np.isnan(upper), np.inf, upper)


def _sum(a: Ends, b: Ends) -> Ends:
    return _known(lambda x, y: x + y, (a[0], b[0]), (a[1], b[1]))


def _times(a: Ends, b: Ends) -> Ends:
    if a[0] is a[1] and b[0] is b[1]:
        found = a[0] * b[0]
        found = np.where(np.isnan(found), 0.0, found)
        return found, found
    corners = np.array([x * y for x in a for y in b])
    corners = np.where(np.isnan(corners), 0.0, corners)  # 0 · ∞
    return corners.min(axis=0), corners.max(axis=0)


def _size(end: Ends) -> Ends:
    low, high = end
    if low is high:
        found = np.abs(low)
        return found, found
    return np.maximum(np.maximum(low, -high), 0.0), np.maximum(np.abs(low), np.abs(high))


def _squared(end: Ends) -> Ends:
    low = end[0] * end[0]
    return low, low if end[1] is end[0] else end[1] * end[1]


# ---- how smooth a motion is, by the length of its spectrum: SPARC
#
# Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, On the analysis of movement smoothness, Journal of
# NeuroEngineering and Rehabilitation 12:112 (2015), with the values that they give: the spectrum up to 10 Hz, or
# up to where it last reaches 5 % of its greatest magnitude, padded four times.

CUTOFF = 10.0
"""Hz, up to where the spectrum counts at most."""
SHARE = 0.05
"""Share of the greatest magnitude: the spectrum counts up to where it last reaches this."""
PADDED = 4
"""How many times as long as the next power of two the transform is."""
AT_REST = 1e-6
"""SI per second or so: below this nothing has moved, and the spectrum is one of rounding."""


def sparc(speed: F64, dt: float) -> float | None:
    """The negative length of the normalised magnitude spectrum of a speed, its frequencies by the cutoff.

    Args:
        speed: (N,) at even spacing, not negative.
        dt: s, the spacing.

    Returns:
        No more than 0; the lower, the less smooth. None of what has not moved, or of one sample.
    """
    if len(speed) < 2 or np.abs(speed).max() < AT_REST:
        return None
    padded = PADDED * 2 ** int(np.ceil(np.log2(len(speed))))
    magnitude = np.abs(np.fft.rfft(speed, padded))
    magnitude /= magnitude.max()
    frequency = np.fft.rfftfreq(padded, dt)
    cutoff = min(float(frequency[np.flatnonzero(magnitude >= SHARE)[-1]]), CUTOFF)
    counted = int(np.searchsorted(frequency, cutoff, "right"))
    if counted < 2:
        return 0.0
    across = np.diff(frequency[:counted]) / cutoff
    return -float(np.hypot(across, np.diff(magnitude[:counted])).sum())
