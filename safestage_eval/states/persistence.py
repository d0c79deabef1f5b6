"""Making a margin persistent: gaps closed, short runs dropped, latched until an event.

Minimum and maximum filters commute with thresholds (Serra, "Image Analysis and Mathematical
Morphology", 1982), so the sign of a filtered margin is the filtered truth, and its value still
says how far the underlying signal is from flipping it. Each filter has a causal twin that looks
only backwards, for use while a rollout is still running.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from .band import F64, Band, Bool

NEVER = -np.inf


def held_from(margin: F64, frames: int) -> F64:
    """Worst margin over the ``frames`` frames that start at each frame; −∞ past the end.

    (T,) → (T,): the frame is the start of a run that lasts long enough iff the result is >= 0.
    """
    if frames <= 1 or not len(margin):
        return margin
    # scipy centres the window at size // 2; the origin moves it so that it starts at the frame
    return minimum_filter1d(
        margin, frames, mode="constant", cval=NEVER, origin=-((frames - 1) // 2) - _even(frames)
    )


def held_until(margin: F64, frames: int) -> F64:
    """Worst margin over the ``frames`` frames that end at each frame; −∞ before the start."""
    return held_from(margin[::-1], frames)[::-1]


def _even(frames: int) -> int:
    return 1 - frames % 2 if frames > 0 else 0


def _seen_until(margin: F64, frames: int) -> F64:
    """Best margin over the ``frames`` frames that end at each frame; nothing before the start."""
    if frames <= 1 or not len(margin):
        return margin
    flipped = maximum_filter1d(
        margin[::-1], frames, mode="constant", cval=NEVER,
        origin=-((frames - 1) // 2) - _even(frames),
    )  # fmt: skip
    return np.asarray(flipped[::-1], np.float64)


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


def persistent(band: Band, for_frames: int, gap_frames: int, *, causal: bool = False) -> Band:
    """Close gaps of at most ``gap_frames``, then drop runs shorter than ``for_frames``.

    The causal form knows no future: a run counts from its ``for_frames``-th frame on, and goes on
    for ``gap_frames`` after its last true frame.
    """
    if causal:
        return Band(*(held_until(_seen_until(m, gap_frames + 1), for_frames) for m in band))
    return Band(*(without_short_runs(without_short_gaps(m, gap_frames), for_frames) for m in band))


def latched(band: Band, reset: Bool, perhaps: Bool | None = None) -> Band:
    """Once true, true until ``reset`` (T,); the reset wins on its own frame.

    ``perhaps``: (T,) all frames at which it may be reset, where not only the certain ones count.
    """
    widest = reset if perhaps is None else perhaps
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
    steps = np.diff(np.concatenate([[0], truth.astype(np.int8), [0]]))
    return np.flatnonzero(steps).reshape(-1, 2)
