"""What time does to margins: windowed extremes for ``for`` and ``gap``, and the latch for ``until``.

Minimum and maximum filters commute with thresholds (Serra, "Image Analysis and Mathematical Morphology",
1982): the sign of a filtered margin is the filtered truth, and its value still says how far the signal is
from flipping it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.clock import Lasting, Window
from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import F64, Bool, Interval
from safestage_eval.rules import syntax as ast

I64 = NDArray[np.int64]

# ---- how long, in samples

ONE, NONE = Lasting(None, 1), Lasting(None, 0)


def lasting(duration: ast.Duration, least: int = 1) -> Lasting:
    """A duration for a clock; at least so many samples."""
    if not duration.amount:
        return Lasting(None, least)
    if duration.frames:
        return Lasting(None, max(least, round(duration.amount)))
    return Lasting(duration.amount, max(least, duration.least), brief=duration.least > 1)


# ---- extremes over windows


def least(margin: F64, firsts: I64, stops: I64) -> F64:
    """(W,) the least margin of the samples [firsts, stops); +∞ where there are none.

    From windows of 1, 2, 4, … samples; two that overlap make one.
    """
    lengths = stops - firsts
    out = np.full(len(lengths), np.inf)
    size, table, longest = 1, margin, int(lengths.max(initial=0))
    while size <= longest:
        here = np.flatnonzero((lengths >= size) & (lengths < 2 * size))
        out[here] = np.minimum(table[firsts[here]], table[stops[here] - size])
        if 2 * size <= longest:
            table = np.minimum(table[:-size], table[size:])
        size *= 2
    return out


def _every(extreme: np.ufunc, margin: F64, frames: int) -> F64:
    """(T,) → (T − frames + 1,): minimum or maximum over every window of so many frames."""
    out, size = margin, 1
    while 2 * size <= frames:
        out, size = extreme(out[:-size], out[size:]), 2 * size
    rest = frames - size
    return extreme(out[:-rest], out[rest:]) if rest else out


def held_from(margin: F64, lasting: Window) -> F64:
    """Worst margin over the duration that starts at each frame; −∞ where it is cut.

    (T,) → (T,): the frame starts a run that lasts long enough iff the result is >= 0.
    """
    frames, total = lasting.frames, len(margin)
    if lasting.stops is not None:
        found = least(margin, np.arange(total), np.minimum(lasting.stops, total))
        return np.where(lasting.stops > total, -np.inf, found)
    if frames <= 1 or not total:
        return margin
    out = np.full(total, -np.inf)
    if frames <= total:
        out[: total - frames + 1] = _every(np.minimum, margin, frames)
    return out


def held_until(margin: F64, lasting: Window, before: float = -np.inf) -> F64:
    """Worst margin over the duration that ends at each frame.

    ``before``: −∞ where it begins before the start; +∞ to take what there is.
    """
    frames, total = lasting.frames, len(margin)
    if lasting.since is not None:
        found = least(margin, np.maximum(lasting.since, 0), np.arange(total) + 1)
        return np.where(lasting.since < 0, np.minimum(found, before), found)
    if frames <= 1 or not total:
        return margin
    return _every(np.minimum, np.concatenate([np.full(frames - 1, before), margin]), frames)


def without_short_runs(margin: F64, lasting: Window, after: float = -np.inf) -> F64:
    """Runs of truth that do not last vanish.

    ``after``: the margin beyond the recording's end; +∞ keeps a run that is cut there.
    """
    frames, total = lasting.frames, len(margin)
    if lasting.stops is None or lasting.backs is None:
        if frames <= 1 or not total:
            return margin
        ends = np.full(frames - 1, -np.inf), np.full(frames - 1, after)
        held = _every(np.minimum, np.concatenate([ends[0], margin, ends[1]]), frames)
        return _every(np.maximum, held, frames)
    # every frame of a long run is in the shortest one from it on, or in that up to the run's end
    at, stops, backs = np.arange(total), lasting.stops, lasting.backs
    ahead = least(margin, at, np.minimum(stops, total))
    ahead = np.where(stops > total, np.minimum(ahead, after), ahead)
    behind = np.where(backs < 0, -np.inf, least(margin, np.maximum(backs, 0), at + 1))
    ahead = least(-ahead, np.searchsorted(stops, at, side="right"), at + 1)
    behind = least(-behind, at, np.searchsorted(backs, at, side="right"))
    return -np.minimum(ahead, behind)


def without_short_gaps(margin: F64, longer: Window, *, open_end: bool = False) -> F64:
    """Short gaps between two true frames are closed.

    Args:
        margin: (T,).
        longer: the shortest gap that is not.
        open_end: a gap at the end may be followed by a true frame.
    """
    if (longer.stops is None and longer.frames <= 1) or not len(margin):
        return margin
    closed = np.minimum(-without_short_runs(-margin, longer), np.maximum.accumulate(margin))
    return closed if open_end else np.minimum(closed, np.maximum.accumulate(margin[::-1])[::-1])


# ---- persistence and latch


def persistent(
    band: Interval,
    lasting: Window,
    open_gap: Window,
    *,
    causal: bool = False,
    open_end: bool = False,
) -> Interval:
    """Close short gaps, then drop short runs.

    The causal form knows no future: a run counts from the frame on at which it has lasted, and
    goes on after its last true frame until the gap is too long.

    Args:
        band: (T,) where it is true.
        lasting: the run that is long enough.
        open_gap: the shortest gap that is not closed.
        causal: which form.
        open_end: more came after the last frame, which is not known; a run that is too short there
            may have been long enough, and a gap closed.
    """

    def filtered(margin: F64, *, end: bool) -> F64:
        if not len(margin):
            return margin
        if causal:
            return held_until(-held_until(-margin, open_gap, np.inf), lasting)
        closed = without_short_gaps(margin, open_gap, open_end=end)
        return without_short_runs(closed, lasting, np.inf if end else -np.inf)

    lower = filtered(band.lower, end=False)
    if band.exact and (causal or not open_end):
        return Interval(lower, lower)
    upper = filtered(band.upper, end=open_end)
    return Interval(lower, lower if band.exact and np.array_equal(lower, upper) else upper)


def latched(band: Interval, reset: Interval) -> Interval:
    """Once true, true until ``reset``; the reset wins on its own frame."""
    lower = _latch(band.lower, reset.possible)
    if band.exact and reset.decided:
        return Interval(lower, lower)
    return Interval(lower, _latch(band.upper, reset.true))


def _latch(margin: F64, reset: Bool) -> F64:
    # Between resets the latched margin is the running maximum from the first true frame on.
    out = np.where(reset, -np.inf, margin)
    if not (out >= 0).any():
        return out
    for first, stop in runs(~reset):
        on = first + np.flatnonzero(out[first:stop] >= 0)
        if len(on):
            out[on[0] : stop] = np.maximum.accumulate(out[on[0] : stop])
    return out


# ---- masks


def widened(frames: Bool, by: int) -> Bool:
    """(T,) true there and up to so many frames before and after."""
    total = len(frames)
    before = np.concatenate([[0], np.cumsum(frames)])
    at = np.arange(total)
    return np.asarray(before[np.minimum(at + by + 1, total)] > before[np.maximum(at - by, 0)])


def last_of(frames: Bool) -> int:
    """The frame after the last true one; 0 without any."""
    at = frames.nonzero()[0]
    return int(at[-1]) + 1 if len(at) else 0
