"""Making a margin persistent: gaps closed, short runs dropped, latched until an event.

Minimum and maximum filters commute with thresholds (Serra, "Image Analysis and Mathematical
Morphology", 1982), so the sign of a filtered margin is the filtered truth, and its value still
says how far the underlying signal is from flipping it. Each filter has a causal twin that looks
only backwards, for use while a rollout is still running.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .band import F64, Band, Bool, each

NEVER = -np.inf


def held_from(margin: F64, frames: int) -> F64:
    """Worst margin over the ``frames`` frames that start at each frame; −∞ past the end.

    (T,) → (T,): the frame is the start of a run that lasts long enough iff the result is >= 0.
    """
    if frames <= 1 or not len(margin):
        return margin
    out = np.full(len(margin), NEVER)
    if frames <= len(margin):
        out[: len(margin) - frames + 1] = _windows(np.minimum, margin, frames)
    return out


def held_until(margin: F64, frames: int) -> F64:
    """Worst margin over the ``frames`` frames that end at each frame; −∞ before the start."""
    return held_from(margin[::-1], frames)[::-1]


def _seen_until(margin: F64, frames: int) -> F64:
    """Best margin over the ``frames`` frames that end at each frame; nothing before the start."""
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


def without_short_runs(margin: F64, frames: int) -> F64:
    """Runs of truth shorter than ``frames`` vanish, a run cut by the trace's end among them."""
    return margin if frames <= 1 else _seen_until(held_from(margin, frames), frames)


def without_short_gaps(margin: F64, frames: int) -> F64:
    """Gaps of at most ``frames`` frames between two true frames are closed."""
    if frames < 1 or not len(margin):
        return margin
    pad = np.full(frames, NEVER)
    spread = _seen_until(np.concatenate([pad, margin, pad]), frames + 1)
    return held_from(spread, frames + 1)[frames:-frames]


def persistent(
    band: Band, for_frames: int, gap_frames: int, *, causal: bool = False, open_end: bool = False
) -> Band:
    """Close gaps of at most ``gap_frames``, then drop runs shorter than ``for_frames``.

    ``open_end``: more came after the last frame, which is not known; a run that is too short there
    may have been long enough, and a gap closed.

    The causal form knows no future: a run counts from its ``for_frames``-th frame on, and goes on
    for ``gap_frames`` after its last true frame.
    """
    if causal:
        return each(lambda m: held_until(_seen_until(m, gap_frames + 1), for_frames), band)
    ahead = for_frames - 1 + gap_frames if open_end else 0
    if ahead:
        frames, beyond = len(band.lower), np.full(ahead, np.inf)
        longer = Band(np.append(band.lower, -beyond), np.append(band.upper, beyond))
        return persistent(longer, for_frames, gap_frames).at(0, frames)
    return each(lambda m: _filtered(m, for_frames, gap_frames), band)


def _filtered(margin: F64, for_frames: int, gap_frames: int) -> F64:
    """Gaps closed, then short runs dropped; a margin that never changes has neither."""
    if len(margin) >= for_frames and len(margin) and bool((margin == margin[0]).all()):
        return margin
    return without_short_runs(without_short_gaps(margin, gap_frames), for_frames)


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


def runs(truth: Bool) -> NDArray[np.int64]:
    """(R, 2) half-open frame intervals [first, stop) of consecutive true frames."""
    if not truth.any():
        return np.zeros((0, 2), np.int64)
    padded = np.zeros(len(truth) + 2, np.bool_)
    padded[1:-1] = truth
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)
