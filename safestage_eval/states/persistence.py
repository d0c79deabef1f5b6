"""Making a margin persistent: gaps closed, short runs dropped, latched until an event.

Minimum and maximum filters commute with thresholds (Serra, "Image Analysis and Mathematical
Morphology", 1982), so the sign of a filtered margin is the filtered truth, and its value still
says how far the underlying signal is from flipping it. Each filter has a causal twin that looks
only backwards, for use while a rollout is still running.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel
from safestage_eval.episode.clock import Window
from safestage_eval.episode.runs import runs

from .band import F64, Band, Bool, each

I64 = NDArray[np.int64]

NEVER = -np.inf
_NONE = np.zeros(0, np.int64)


def held_from(margin: F64, lasting: int | Window) -> F64:
    """Worst margin over the run of frames that starts at each frame; −∞ past the end.

    (T,) → (T,): the frame is the start of a run that lasts long enough iff the result is >= 0.
    ``lasting``: how many frames make up the run.
    """
    frames, stops, _ = _unpacked(lasting)
    if stops is not None:
        return _ahead(margin, stops, open_end=False)
    if frames <= 1 or not len(margin):
        return margin
    out = _never(len(margin))
    if frames <= len(margin):
        out[: len(margin) - frames + 1] = _windows(np.minimum, margin, frames)
    return out


def _never(frames: int) -> F64:
    """(T,) −∞ throughout; ``np.full`` takes longer."""
    out = np.empty(frames)
    out.fill(NEVER)
    return out


def held_until(margin: F64, lasting: int | Window) -> F64:
    """Worst margin over the run of frames that ends at each frame; −∞ before the start."""
    if isinstance(lasting, Window) and lasting.since is not None:
        return _behind(margin, lasting.since)
    frames, _, _ = _unpacked(lasting)
    return held_from(margin[::-1], frames)[::-1]


def _seen_until(margin: F64, open_gap: Window) -> F64:
    """Best margin over the run of frames that ends at each frame; nothing before the start."""
    frames = open_gap.frames
    if open_gap.since is not None:
        return -_behind(-margin, open_gap.since, open_start=True)
    if frames <= 1 or not len(margin):
        return margin
    return _windows(np.maximum, np.concatenate([np.full(frames - 1, NEVER), margin]), frames)


def _windows(extreme: np.ufunc, margin: F64, frames: int) -> F64:
    """(T,) → (T − frames + 1,): minimum or maximum over every window of so many frames.

    Windows of 2, 4, 8 … frames are made of two halves each; two that overlap make the last.
    """
    out, size = margin, 1
    while 2 * size <= frames:
        out = extreme(out[:-size], out[size:])
        size *= 2
    rest = frames - size
    return extreme(out[:-rest], out[rest:]) if rest else out


def _unpacked(lasting: int | Window) -> tuple[int, I64 | None, I64]:
    if isinstance(lasting, int):
        return lasting, None, _NONE
    return lasting.frames, lasting.stops, _NONE if lasting.backs is None else lasting.backs


def _ahead(margin: F64, stops: I64, *, open_end: bool) -> F64:
    """(T,) the least margin from each frame up to its stop; beyond the end −∞, or what there is."""
    total = len(margin)
    least = _least(margin, np.arange(total), np.minimum(stops, total))
    return least if open_end else np.where(stops > total, NEVER, least)


def _behind(margin: F64, backs: I64, *, open_start: bool = False) -> F64:
    """(T,) the least margin down to each frame's first; before the start −∞, or what there is."""
    least = _least(margin, np.maximum(backs, 0), np.arange(len(margin)) + 1)
    return least if open_start else np.where(backs < 0, NEVER, least)


def _least(margin: F64, firsts: I64, stops: I64) -> F64:
    """(W,) the least margin in each of W windows [first, stop), neither of which ever goes back."""
    out = np.empty(len(firsts))
    queue = np.empty(len(margin), np.int64)
    _slide(np.ascontiguousarray(margin), firsts, stops, queue, out)
    return out


@kernel
def _slide(margin: F64, firsts: I64, stops: I64, queue: I64, out: F64) -> None:
    """The queue holds the frames of a window that are less than all behind them, in order."""
    head, tail, taken = 0, 0, 0
    for window in range(len(out)):
        while taken < stops[window]:
            while tail > head and margin[queue[tail - 1]] >= margin[taken]:
                tail -= 1
            queue[tail] = taken
            tail += 1
            taken += 1
        while head < tail and queue[head] < firsts[window]:
            head += 1
        out[window] = margin[queue[head]] if head < tail else np.inf


def without_short_runs(margin: F64, lasting: int | Window, *, open_end: bool = False) -> F64:
    """Runs of truth that do not last vanish, a run cut by the trace's end among them.

    ``open_end``: that run stays.
    """
    frames, stops, backs = _unpacked(lasting)
    if stops is not None:
        # every frame of a long run is in the shortest one from it on, or in that up to the run's end
        ahead = _least(-_ahead(margin, stops, open_end=open_end), *_with_stops(stops))
        behind = _least(-_behind(margin, backs), *_with_backs(backs))
        return -np.minimum(ahead, behind)
    if frames <= 1 or not len(margin):
        return margin
    held = _never(len(margin) + frames - 1)
    if frames <= len(margin):
        held[frames - 1 : len(margin)] = _windows(np.minimum, margin, frames)
    return _windows(np.maximum, held, frames)


def _with_stops(stops: I64) -> tuple[I64, I64]:
    """First and last (excluded) of the windows [i, stop) that hold each frame."""
    at = np.arange(len(stops))
    return np.searchsorted(stops, at, side="right"), at + 1


def _with_backs(backs: I64) -> tuple[I64, I64]:
    """First and last (excluded) of the windows [back, i] that hold each frame."""
    at = np.arange(len(backs))
    return at, np.searchsorted(backs, at, side="right")


def without_short_gaps(margin: F64, closed: int | Window, *, open_end: bool = False) -> F64:
    """Short gaps between two true frames are closed.

    Args:
        margin: (T,).
        closed: the longest gap that is, in frames; or the window of the shortest that is not.
        open_end: a gap at the end may be followed by a true frame.
    """
    if isinstance(closed, Window) and closed.stops is not None:
        _, _, backs = _unpacked(closed)
        ahead = -_ahead(-margin, closed.stops, open_end=True)
        if open_end:
            ahead[closed.stops > len(margin)] = np.inf
        behind = -_behind(-margin, backs, open_start=True)
        margins = np.minimum(
            _least(ahead, *_with_stops(closed.stops)), _least(behind, *_with_backs(backs))
        )
        return np.minimum(margins, np.maximum.accumulate(margin))
    frames = closed if isinstance(closed, int) else closed.frames - 1
    if frames < 1 or not len(margin):
        return margin
    longer = _never(len(margin) + 2 * frames)
    longer[frames:-frames] = margin
    return _windows(np.minimum, _windows(np.maximum, longer, frames + 1), frames + 1)


def persistent(
    band: Band,
    lasting: int | Window,
    open_gap: int | Window,
    *,
    causal: bool = False,
    open_end: bool = False,
) -> Band:
    """Close short gaps, then drop short runs.

    The causal form knows no future: a run counts from the frame on at which it has lasted, and
    goes on after its last true frame until the gap is too long.

    Args:
        band: (T,) where it is true.
        lasting: the run that is long enough, in frames or as a window.
        open_gap: the longest gap that is closed, in frames; or the window of the shortest that is
            not.
        causal: which form.
        open_end: more came after the last frame, which is not known; a run that is too short there
            may have been long enough, and a gap closed.
    """
    lasting = Window(lasting) if isinstance(lasting, int) else lasting
    open_gap = Window(open_gap + 1) if isinstance(open_gap, int) else open_gap
    filtered = _causal if causal else _filtered
    open_end = open_end and not causal
    lower = filtered(band.lower, lasting, open_gap, False)
    if band.lower is band.upper and not open_end:
        return Band(lower, lower)
    return Band(lower, filtered(band.upper, lasting, open_gap, open_end))


def _causal(margin: F64, lasting: Window, open_gap: Window, _: bool) -> F64:
    return held_until(_seen_until(margin, open_gap), lasting)


def _filtered(margin: F64, lasting: Window, open_gap: Window, open_end: bool) -> F64:
    """Gaps closed, then short runs dropped; a margin that never changes has neither."""
    frames = len(margin)
    if lasting.stops is not None or open_gap.stops is not None:
        if not frames:
            return margin
        closed = without_short_gaps(margin, _stamped(open_gap, frames), open_end=open_end)
        return without_short_runs(closed, _stamped(lasting, frames), open_end=open_end)
    ahead = lasting.frames - 1 + open_gap.frames - 1 if open_end else 0
    if ahead:
        longer = np.append(margin, np.full(ahead, np.inf))
        return _filtered(longer, lasting, open_gap, False)[:frames]
    if frames >= lasting.frames and frames and _constant(margin):
        return margin
    return without_short_runs(without_short_gaps(margin, open_gap.frames - 1), lasting.frames)


def _stamped(window: Window, frames: int) -> Window:
    """A window of ``frames`` frames everywhere, given frame by frame."""
    if window.stops is not None:
        return window
    stops = np.arange(frames) + window.frames
    stops = np.where(stops > frames, frames + 1, stops)
    return Window(window.frames, stops, np.arange(frames) + 1 - window.frames)


def _constant(margin: F64) -> bool:
    return bool(margin[0] == margin[-1] and (margin == margin[0]).all())


def latched(band: Band, reset: Bool, perhaps: Bool | None = None) -> Band:
    """Once true, true until ``reset`` (T,); the reset wins on its own frame.

    ``perhaps``: (T,) all frames at which it may be reset, where not only the certain ones count.
    """
    widest = reset if perhaps is None else perhaps
    if band.exact and np.array_equal(widest, reset):
        return each(lambda margin: _latch(margin, reset), band)
    return Band(_latch(band.lower, widest), _latch(band.upper, reset))


def _latch(margin: F64, reset: Bool) -> F64:
    # Between resets the latched margin is the running maximum from the first true frame on.
    out = np.where(reset, NEVER, margin)
    for first, stop in runs(~reset):
        on = first + np.flatnonzero(out[first:stop] >= 0)
        if len(on):
            out[on[0] : stop] = np.maximum.accumulate(out[on[0] : stop])
    return out
