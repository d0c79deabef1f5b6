"""The frames that a change is measured from: the first in which a body rests, or those of an event."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle, mean_orientation

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Baseline:
    """The first frames of the episode, over which the initial state is estimated.

    Median position and mean orientation over the first five frames reduce initialisation noise.
    Frames behind a hole do not count.
    """

    frames: int = 5
    start: int = 0
    """The first of them: 0 but for a body that settles first. Before it, nothing counts as moved."""
    notes: tuple[str, ...] = ()
    """Notes on the reference, for the reader of a change measured from it."""
    asked: int = 5
    """How many frames there would be without a hole."""

    @property
    def stretch(self) -> slice:
        """These frames."""
        return slice(self.start, self.start + self.frames)

    def position(self, values: F64) -> F64:
        """(T, 3) → (3,) m: the spatial median over the baseline frames, as a medoid.

        The frame whose summed distance to the others is least. One wild frame does not move it,
        and unlike the median of each coordinate it does not depend on how the world's axes lie.
        """
        some = values[self.stretch]
        between = some[:, None] - some[None]
        apart = np.sqrt(np.add.reduce(between * between, axis=2)).sum(axis=0)
        medoid: F64 = some[int(np.argmin(apart))]
        return medoid

    def orientation(self, quaternions: NDArray[np.floating]) -> F64:
        """(T, 4) wxyz → (4,): the mean over the baseline frames."""
        return mean_orientation(quaternions[self.stretch])


@dataclass(frozen=True, eq=False)
class Reference:
    """Where each frame looks back to.

    Attributes:
        baseline: used where ``since`` is −1.
        since: (T,) frame of the latest event at or before each frame, −1 if there was none yet;
            None to refer to the baseline throughout.
        key: identifies it among the references of one episode.
    """

    baseline: Baseline
    since: NDArray[np.int64] | None = None
    key: str = ""

    def of(self, values: NDArray[np.floating], initial: F64) -> F64:
        """The reference value at each frame: (T, k) values and (k,) baseline value → (T, k)."""
        start = self.baseline.start
        if self.since is None or not len(self.since) or self.since[-1] < 0:  # no event at all
            there = np.broadcast_to(initial, values.shape)
            return np.concatenate([values[:start], there[start:]]) if start else there
        picked = np.take(values, self.since, axis=0, mode="clip").astype(np.float64)
        first = int(np.argmax(self.since >= 0))
        picked[:first] = initial
        picked[: min(start, first)] = values[: min(start, first)]
        return picked


def latest(instants: NDArray[np.int64], frames: int) -> NDArray[np.int64]:
    """(T,) frame of the latest instant at or before each frame, −1 where there is none yet."""
    since = np.full(frames, -1, np.int64)
    since[instants] = instants
    return np.maximum.accumulate(since)


SETTLES = 1.0
"""s. What has not come to rest by then was not ready to be judged."""
RESTS = 0.1
"""s. A body rests that for so long goes …"""
STAYS = 1e-3
"""m. … less than this (1 cm/s, the parameter ``still``) …"""
STAYS_TURN = 0.0175
"""rad. … and turns by less than this."""


def settled(
    episode: Episode, name: str, baseline: Baseline, untouched: Callable[[str], int]
) -> Baseline:
    """The first frames in which an object rests, before the robot has to do with it.

    The given baseline for everything that rests at the start, and for what the robot moves from the
    start. Of an object that does not come to rest within a second it is the given one too, with the
    note that the scene is invalid.
    """
    body, track, t = episode.bodies[name], episode.tracks[name], episode.t
    if body.kind != "object" or not body.movable or len(track.position) < 2:
        return baseline
    stop = max(int(t.searchsorted(t[0] + SETTLES)), min(baseline.frames, len(t)))
    place, turn = track.position[:stop], track.orientation[:stop]
    away = np.abs(place - place[0]).max(axis=1) > STAYS
    away |= angle(turn, turn[0].astype(np.float64)) > STAYS_TURN
    if not away.any():
        return baseline
    stop = min(stop, untouched(name))
    if not away[:stop].any():
        return baseline  # the robot moved it
    unseen = np.zeros(stop, np.bool_) if episode.unseen is None else episode.unseen
    place = place.astype(np.float64)  # squares of single precision overflow
    long = max(baseline.frames, int(np.ceil(RESTS / episode.dt - 1e-6)) + 1)
    for start in range(stop - long + 1):
        here = slice(start, start + long)
        if unseen[here].any():
            continue
        gone = np.linalg.norm(place[here] - place[start], axis=1).max() > STAYS
        if not gone and angle(turn[here], turn[start].astype(np.float64)).max() <= STAYS_TURN:
            if not start:
                return baseline
            when = f"the initial state of {name} is that at {t[start]:.2f} s, when it first rested"
            return replace(baseline, start=start, notes=(when,))
    if t[-1] - t[0] < SETTLES and stop == len(t):  # a recording that has only begun
        return replace(baseline, start=max(len(t) - baseline.frames, 0))
    why = f"invalid scene: {name} moves at the start and does not come to rest within {SETTLES:g} s"
    return replace(baseline, notes=(why,))
