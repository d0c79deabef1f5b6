"""Moments of an episode for pictures, chosen by motion and contact, not by any rule."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle

F64 = NDArray[np.float64]

RATE = 30.0
"""Hz at which motion is looked at."""
MOVING = 0.02
"""m/s, with ``LEVER`` for turns, from which a body counts as moving."""
LEVER = 0.05
"""m, what turns a rotation into a path."""
SPREAD = 0.2
"""s about an event within which pictures are taken more often, and of gaps of touch that begin nothing new."""
REST = 0.08
"""Share of the pictures that a second without motion gets of one with motion."""


def key_frames(episode: Episode, count: int, watched: Sequence[str]) -> list[int]:
    """Indices of frames, ascending: the first and the last, and more of them where something happens.

    Half of the pictures go to events: a body starts or stops moving, a touch begins or ends, native success.

    Args:
        episode: what happened.
        count: how many, at least 2; fewer come back of an episode of fewer frames.
        watched: the bodies whose motion and touches count.
    """
    last = len(episode) - 1
    if count > last:
        return list(range(last + 1))
    steps = np.arange(episode.t[0], episode.t[-1], 1 / RATE)
    frames = np.unique(np.append(np.searchsorted(episode.t, steps), last))
    times = episode.t[frames]
    stirred = np.zeros(len(frames), bool)
    for body in episode.header.bodies:
        if body.name in watched and body.movable:
            stirred |= _moves(episode, body.name, frames)
    events = times[1:][np.diff(stirred.astype(int)) != 0].tolist() + _touches(episode, watched)
    if episode.header.success_time is not None:
        events.append(episode.header.success_time)
    density = np.where(stirred, 1.0, REST) * np.gradient(times)
    density /= density.sum()
    merged = [
        e for i, e in enumerate(sorted(events)) if not i or e - sorted(events)[i - 1] > SPREAD
    ]
    if merged:
        bumps = np.exp(-0.5 * ((times[:, None] - np.array(merged)) / SPREAD) ** 2).sum(1)
        density = (density + bumps / bumps.sum()) / 2
    reached = np.concatenate([[0.0], np.cumsum(density)])[:-1] / density[:-1].sum()
    wanted = np.interp(np.linspace(0, 1, count), reached, frames.astype(float))
    # no frame twice
    number = np.arange(count)
    up = np.maximum.accumulate(np.round(wanted).astype(int) - number) + number
    return [int(frame) for frame in np.minimum(up, last - number[::-1])]


def _moves(episode: Episode, name: str, frames: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(N,) whether a body moves from one of some frames to the next."""
    track = episode.tracks[name].over(len(episode))
    after = np.append(frames[1:], frames[-1])
    path = np.linalg.norm(track.position[after] - track.position[frames], axis=1)
    turned = angle(
        track.orientation[after].astype(np.float64), track.orientation[frames].astype(np.float64)
    )
    span = np.maximum(episode.t[after] - episode.t[frames], 1e-9)
    return np.asarray((path + LEVER * turned) > MOVING * span)


def _touches(episode: Episode, watched: Sequence[str]) -> list[float]:
    """When a touch of a watched body begins or ends; the robot's bodies count as one."""
    table, bodies = episode.contacts, episode.header.bodies
    kinds = np.array([-1 if b.kind in ("robot", "gripper") else i for i, b in enumerate(bodies)])
    counts = np.array([body.name in watched for body in bodies])
    one, two = table.body1.astype(int), table.body2.astype(int)
    row = counts[one] | counts[two]
    result: list[float] = []
    pairs = (kinds[one] + 1) * (len(bodies) + 1) + kinds[two] + 1
    for pair in np.unique(pairs[row]):
        times = episode.t[np.unique(table.frame[row & (pairs == pair)])]
        breaks = np.flatnonzero(np.diff(times) > SPREAD)
        result += [*times[np.append(0, breaks + 1)], *times[np.append(breaks, len(times) - 1)]]
    edge = 2 * episode.dt
    return [float(t) for t in result if episode.t[0] + edge < t < episode.t[-1] - edge]
