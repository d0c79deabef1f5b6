"""Forces at contacts: summed over two bodies or one, at their peak, and over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

F64 = NDArray[np.float64]

ROUNDING = 1e-6
"""Forces are stored as float32: sums that differ by no more than this share are the same."""


@signal(
    "contact_force", "force", args=("a", "b"), needs=("forces",), groups=True, scale=1.0, reads="",
    symmetric=True,
)  # fmt: skip
def contact_force(request: Request) -> Interval:
    """Sum of the magnitudes of the normal forces of all contacts between the two."""
    return _force(request, peaks=False)


@signal(
    "peak_force", "force", args=("a", "b"), needs=("forces",), groups=True, scale=1.0, reads="",
    symmetric=True,
)  # fmt: skip
def peak_force(request: Request) -> Interval:
    """Largest value of that sum over the physics steps within the frame."""
    return _force(request, peaks=True)


@signal(
    "total_force", "force", args=("a",), needs=("forces",), groups=True, scale=1.0, reads="",
)  # fmt: skip
def total_force(request: Request) -> Interval:
    """Sum of the magnitudes of all normal forces on the body."""
    return _force(request, peaks=False)


def _force(request: Request, *, peaks: bool) -> Interval:
    """N, summed over the pairs of two unions, or of one with everything else.

    The peaks of several pairs need not be at one moment: ``peak_force`` is at least the largest and
    at most their sum, and just that where each is the pair's force at the frame. A force that is not
    known may be any.
    """
    gaps = request.facts.gaps
    sums, pairs = request.facts.contact_sums, _pairs(request)
    total = np.zeros(len(request.episode))
    if not gaps.forces:
        unknown = request.unknown(gaps.about_forces)
        if not peaks or request.episode.header.force_source == "none":
            return unknown
        for i, j in pairs:  # a peak that was recorded was there, whatever the forces
            total = np.maximum(total, sums.peak(i, j))
        lower = np.where(total > 0, total, unknown.lower)
        return Interval(lower, unknown.upper, unknown.dimension, unknown.notes)
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
    lost = gaps.of_pairs(pairs, peaks=peaks)
    if lost is not None:
        total = np.where(lost, np.inf, total)
    return Interval(least, total, request.dimension, gaps.told(pairs, peaks=peaks))


@signal(
    "contact_count", "number", args=("a", "b"), needs=("forces",), groups=True, scale=1.0, reads="",
    symmetric=True,
)  # fmt: skip
def contact_count(request: Request) -> Interval:
    """Number of contact points at which the two press on each other."""
    gaps = request.facts.gaps
    if not gaps.forces:
        return request.unknown(gaps.about_forces)
    pairs = _pairs(request)
    count = np.zeros(len(request.episode))
    for pair in pairs:
        request.facts.contact_sums.normal(*pair)  # looks whether its contacts are sound
        frame, force = request.episode.contacts.of_pair(pair, "frame", "force")
        np.add.at(count, frame[force.any(axis=1)], 1.0)
    lost, most = gaps.of_pairs(pairs), count
    if lost is not None:
        count, most = np.where(lost, 0.0, count), np.where(lost, np.inf, count)
    return Interval(count, most, request.dimension, gaps.told(pairs))


@signal(
    "impulse", "impulse", args=("a", "b"), needs=("forces",), groups=True, scale=0.1, reads="",
    sums="up", symmetric=True,
)  # fmt: skip
def impulse(request: Request) -> Interval:
    """Time integral of the contact force since the two last began to touch; 0 when they do not.

    N s. The force at a frame acts over the time since the frame before. At the first frame of a touch,
    and of one between two frames, of which only the peak is known, that is at least one physics
    step and at most the whole frame. From a frame on at which the force is not known the integral
    may be any, while the touch lasts.
    """
    episode, gaps = request.episode, request.facts.gaps
    if not gaps.forces:
        return request.unknown(gaps.about_forces)
    seconds = np.diff(episode.t, prepend=episode.t[0] - episode.dt)
    step = np.minimum(episode.header.physics_dt, seconds)
    lower, upper = np.zeros(len(episode)), np.zeros(len(episode))
    touching = np.zeros(len(episode), np.bool_)
    pairs, lost = _pairs(request), gaps.unseen
    for i, j in pairs:
        force = request.facts.contact_sums.normal(i, j)
        peak = request.facts.contact_sums.peak(i, j)
        unknown = request.facts.contact_sums.touch_unknown(i, j)
        lost = unknown if lost is None else lost if unknown is None else lost | unknown
        begins = (force > 0) & (np.concatenate([[0.0], force[:-1]]) <= 0)
        lower += np.where(force > 0, force * np.where(begins, step, seconds), peak * step)
        upper += np.where(force > 0, force * seconds, peak * seconds)
        touching |= peak > 0
    most = _since_touching(upper, touching)
    if lost is not None:
        may = touching | lost
        begun = np.maximum.accumulate(np.where(may, 0, np.arange(1, len(may) + 1)))
        since = np.cumsum(lost)
        before = np.concatenate([[0], since])[begun]
        most = np.where(may & (since > before), np.inf, _since_touching(upper, may))
    notes = () if lost is None else gaps.told(pairs, peaks=True)
    return Interval(_since_touching(lower, touching), most, request.dimension, notes)


def _since_touching(gains: F64, touching: NDArray[np.bool_]) -> F64:
    """(T,) running sum of gains (T,) that starts anew with every stretch of touching (T,)."""
    total = np.cumsum(gains)
    before = np.maximum.accumulate(np.where(touching, 0.0, total))
    return np.where(touching, total - before, 0.0)


def _pairs(request: Request) -> list[tuple[int, int]]:
    """The touching pairs (indices of bodies) of two unions, or of one and everything else."""
    index = request.episode.body_index
    first = {index[body] for body in request.groups[0]}
    second = (
        {index[body] for body in request.groups[1]}
        if len(request.groups) > 1
        else set(index.values()) - first
    )
    return [
        (i, j)
        for i, j in request.facts.contact_sums.pairs
        if (i in first and j in second) or (j in first and i in second)
    ]
