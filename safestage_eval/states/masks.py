"""Some frames of an episode, as masks (T,)."""

from __future__ import annotations

import numpy as np

from .band import Bool


def widened(frames: Bool, by: int) -> Bool:
    """(T,) true there and up to so many frames before and after."""
    total = len(frames)
    before = np.concatenate([[0], np.cumsum(frames)])
    at = np.arange(total)
    return np.asarray(before[np.minimum(at + by + 1, total)] > before[np.maximum(at - by, 0)])


def followed(frames: Bool, by: int) -> Bool:
    """(T,) true there and up to so many frames after."""
    before = np.concatenate([[0], np.cumsum(frames)])
    at = np.arange(len(frames))
    return np.asarray(before[at + 1] > before[np.maximum(at - by, 0)])


def sample(frames: Bool, every: int) -> Bool:
    """(T,) so many of the frames that every run of ``every`` frames with one of them has one of these."""
    if every <= 2:
        return frames
    at = frames.nonzero()[0]
    out = np.zeros(len(frames), np.bool_)
    starts = np.concatenate([[True], np.diff(at) > 1]) if len(at) else np.zeros(0, np.bool_)
    since = at - at[np.maximum.accumulate(np.where(starts, np.arange(len(at)), 0))]
    last = np.append(starts[1:], True)
    out[at[(since % every == 0) | last]] = True
    return out


def last_of(frames: Bool) -> int:
    """The frame after the last true one; 0 without any."""
    at = frames.nonzero()[0]
    return int(at[-1]) + 1 if len(at) else 0
