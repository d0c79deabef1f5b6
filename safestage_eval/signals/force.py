"""Signals of the forces at contacts, and of their action over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .facts import Query
from .series import Series

F64 = NDArray[np.float64]

ROUNDING = 1e-6
"""Forces are stored as float32: sums that differ by no more than this share are the same."""


def between(query: Query) -> Series:
    """N, summed over the pairs of two unions, or of one with everything else.

    The peaks of several pairs need not be at one moment: ``peak_force`` is at least the largest and
    at most their sum, and just that where each is the pair's force at the frame. A force that is not
    known may be any.
    """
    gaps = query.facts.gaps
    if not gaps.forces:
        return query.unknown(gaps.about_forces)
    sums, pairs = query.facts.contact_sums, _pairs(query)
    peaks = query.name == "peak_force"
    total = np.zeros(len(query.episode))
    least = total
    for i, j in pairs:
        force = (sums.peak if peaks else sums.normal)(i, j)
        total = total + force
        if peaks:
            least = np.maximum(least, force)
    if not peaks or len(pairs) < 2:
        least = total
    else:  # the sum at the frame is one that there was
        at_once = sum(sums.normal(i, j) for i, j in pairs)
        least = np.where(total <= at_once * (1 + ROUNDING), total, np.maximum(least, at_once))
    lost = gaps.of_pairs(pairs)
    if lost is not None:
        total = np.where(lost, np.inf, total)
    return Series(least, total, query.dimension, gaps.told(pairs))


def impulse(query: Query) -> Series:
    """N s, time integral of the contact force since the two last began to touch.

    The force at a frame acts over the time since the frame before. At the first frame of a touch,
    and of one between two frames, of which only the peak is known, that is at least one physics
    step and at most the whole frame. From a frame on at which the force is not known the integral
    may be any, while the touch lasts.
    """
    episode, gaps = query.episode, query.facts.gaps
    if not gaps.forces:
        return query.unknown(gaps.about_forces)
    seconds = np.diff(episode.t, prepend=episode.t[0] - episode.dt)
    step = np.minimum(episode.header.physics_dt, seconds)
    lower, upper = np.zeros(len(episode)), np.zeros(len(episode))
    touching = np.zeros(len(episode), np.bool_)
    pairs = _pairs(query)
    for i, j in pairs:
        force = query.facts.contact_sums.normal(i, j)
        peak = query.facts.contact_sums.peak(i, j)
        begins = (force > 0) & (np.concatenate([[0.0], force[:-1]]) <= 0)
        lower += np.where(force > 0, force * np.where(begins, step, seconds), peak * step)
        upper += np.where(force > 0, force * seconds, peak * seconds)
        touching |= peak > 0
    most = _since_touching(upper, touching)
    lost = gaps.of_pairs(pairs)
    if lost is not None:
        may = touching | lost
        begun = np.maximum.accumulate(np.where(may, 0, np.arange(1, len(may) + 1)))
        since = np.cumsum(lost)
        before = np.concatenate([[0], since])[begun]
        most = np.where(may & (since > before), np.inf, _since_touching(upper, may))
    return Series(_since_touching(lower, touching), most, query.dimension, gaps.told(pairs))


def _since_touching(gains: F64, touching: NDArray[np.bool_]) -> F64:
    """(T,) running sum of gains (T,) that starts anew with every stretch of touching (T,)."""
    total = np.cumsum(gains)
    before = np.maximum.accumulate(np.where(touching, 0.0, total))
    return np.where(touching, total - before, 0.0)


def _pairs(query: Query) -> list[tuple[int, int]]:
    """The pairs of bodies that touch at some frame and that the query is about."""
    index = query.episode.body_index
    first = {index[body] for body in query.groups[0]}
    second = (
        {index[body] for body in query.groups[1]}
        if len(query.groups) > 1
        else set(index.values()) - first
    )
    return [
        (i, j)
        for i, j in query.facts.contact_sums.pairs
        if (i in first and j in second) or (j in first and i in second)
    ]
