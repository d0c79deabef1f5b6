"""Which contacts of the physics steps between two frames a frame keeps, and their largest forces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Kept(NamedTuple):
    """K contacts that frames keep, frame by frame.

    Attributes:
        rows: (K,) which contacts.
        frame: (K,) the frame that keeps each.
        own: (K,) whether the contact is of the frame's own step; else its pair touched before only,
            and has this row without force.
        peak: (K,) N, largest force of the pair in a step since the frame before.
    """

    rows: Any
    frame: Any
    own: Any
    peak: Any


def keep_contacts(step: Any, pair: Any, normal: Any, ends: Any) -> Kept:
    """Choose among C contacts of S steps.

    Args:
        step: (C,) number of the step of each, ascending.
        pair: (C,) number of the pair of bodies of each, from 0 on without great gaps.
        normal: (C,) N, normal force.
        ends: (F,) where the steps of each frame end; the last one is the frame's own.
    """
    many = int(pair.max(initial=-1)) + 1
    frames = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    sums = np.bincount(step * many + pair, normal, len(frames) * many).reshape(-1, many)
    peaks = np.maximum.reduceat(sums, np.append(0, ends[:-1])).ravel()
    is_frame = np.zeros(len(frames), bool)
    is_frame[ends - 1] = True
    at, whole = frames[step], is_frame[step]
    of_frame = at * many + pair
    rows = np.flatnonzero(whole)
    there = np.zeros(len(peaks), bool)
    there[of_frame[rows]] = True
    others = np.flatnonzero(~there[of_frame])
    if len(others):
        _, first = np.unique(of_frame[others], return_index=True)
        rows = np.concatenate([rows, others[first]])
        rows = rows[np.argsort(at[rows], kind="stable")]
    return Kept(rows, at[rows], whole[rows], peaks[of_frame[rows]])
