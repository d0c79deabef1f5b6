"""Signals of the forces at contacts, and of their action over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .facts import Query
from .series import Series, exact

F64 = NDArray[np.float64]


def between(query: Query) -> Series:
    """N, summed over the pairs of two unions, or of one with everything else.

    ``peak_force`` sums the peaks of the pairs, the others the normal forces at the frame.
    """
    if query.episode.header.force_source == "none":
        return query.unknown("the trace has no contact forces")
    sums = query.facts.contact_sums
    force = sums.peak if query.name == "peak_force" else sums.normal
    total = np.zeros(len(query.episode))
    for i, j in _pairs(query):
        total = total + force(i, j)
    return exact(total, query.dimension)


def impulse(query: Query) -> Series:
    """N s, time integral of the contact force since the two last began to touch.

    The force at a frame acts over the time since the frame before. Of a touch between two frames
    only the peak is known: it lasted at least one physics step and at most the whole frame.
    """
    episode = query.episode
    if episode.header.force_source == "none":
        return query.unknown("the trace has no contact forces")
    seconds = np.diff(episode.t, prepend=episode.t[0] - episode.dt)
    step = np.minimum(episode.header.physics_dt, seconds)
    lower, upper = np.zeros(len(episode)), np.zeros(len(episode))
    touching = np.zeros(len(episode), np.bool_)
    for i, j in _pairs(query):
        force = query.facts.contact_sums.normal(i, j)
        peak = query.facts.contact_sums.peak(i, j)
        lower += np.where(force > 0, force * seconds, peak * step)
        upper += np.where(force > 0, force * seconds, peak * seconds)
        touching |= peak > 0
    return Series(
        _since_touching(lower, touching), _since_touching(upper, touching), query.dimension
    )


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
