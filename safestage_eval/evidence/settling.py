"""When a body of the scene comes to rest: a scene may still settle as its recording begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle

from .reference import Baseline

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
