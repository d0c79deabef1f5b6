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
    out = _never(len(margin))
    if frames <= len(margin):
        out[: len(margin) - frames + 1] = _windows(np.minimum, margin, frames)
    return out


def _never(frames: int) -> F64:
    """(T,) −∞ throughout; ``np.full`` takes longer."""
    out = np.empty(frames)
    out.fill(NEVER)
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
    if frames <= 1 or not len(margin):
        return margin
    held = _never(len(margin) + frames - 1)
    if frames <= len(margin):
        held[frames - 1 : len(margin)] = _windows(np.minimum, margin, frames)
    return _windows(np.maximum, held, frames)


def without_short_gaps(margin: F64, frames: int) -> F64:
    """Gaps of at most ``frames`` frames between two true frames are closed."""
    if frames < 1 or not len(margin):
        return margin
    longer = _never(len(margin) + 2 * frames)
    longer[frames:-frames] = margin
    return _windows(np.minimum, _windows(np.maximum, longer, frames + 1), frames + 1)


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
    lower = _filtered(band.lower, for_frames, gap_frames)
    exact = band.lower is band.upper
    return Band(lower, lower if exact else _filtered(band.upper, for_frames, gap_frames))


def _filtered(margin: F64, for_frames: int, gap_frames: int) -> F64:
    """Gaps closed, then short runs dropped; a margin that never changes has neither."""
    if len(margin) >= for_frames and len(margin) and _constant(margin):
        return margin
    return without_short_runs(without_short_gaps(margin, gap_frames), for_frames)


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


def runs(truth: Bool) -> NDArray[np.int64]:
    """(R, 2) half-open frame intervals [first, stop) of consecutive true frames."""
    if not len(truth):
        return np.zeros((0, 2), np.int64)
    changes = (truth[1:] != truth[:-1]).nonzero()[0]
    begun, open_ = int(truth[0]), int(truth[-1])
    out = np.empty(begun + len(changes) + open_, np.int64)
    out[:begun], out[len(out) - open_ :] = 0, len(truth)
    np.add(changes, 1, out=out[begun : begun + len(changes)])
    return out.reshape(-1, 2)
