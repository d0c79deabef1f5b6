"""Moments of an episode for pictures, chosen by motion and contact, not by any rule."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.pose import angle

F64 = NDArray[np.float64]

RATE = 30.0
"""Hz at which motion is looked at."""
WINDOW = 3
"""Samples over which a speed is taken."""
MOVING = 0.02
"""m/s, with ``LEVER`` for turns, from which a body counts as moving."""
LEVER = 0.05
"""m, what turns a rotation into a path."""
PAUSE = 0.2
"""s, shorter rests and gaps of touch begin nothing new."""
SPREAD = 0.2
"""s about an event within which pictures are taken more often."""
REST = 0.08
"""Share of the pictures that a second without motion gets of one with motion."""
ON_EVENTS = 0.5
"""Share of the pictures that go to events."""


def key_frames(episode: Episode, count: int, watched: Sequence[str]) -> list[int]:
    """Indices of frames, ascending: the first and the last, and more of them where something happens.

    A body that starts or stops moving, a touch that begins or ends, and native success are events.

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
    bodies = [body for body in episode.header.bodies if body.name in watched and body.movable]
    moves = {body.name: _moves(episode, body, frames) for body in bodies}
    events = [time for moving in moves.values() for time in _changes(times, moving)]
    events += _touches(episode, watched)
    if episode.header.success_time is not None:
        events.append(episode.header.success_time)
    stirred = np.any([*moves.values()], axis=0) if moves else np.ones(len(frames), bool)
    density = np.where(stirred, 1.0, REST) * np.gradient(times)
    density /= density.sum()
    if events:
        bumps = np.exp(-0.5 * ((times[:, None] - _merged(events)) / SPREAD) ** 2).sum(1)
        density = (1 - ON_EVENTS) * density + ON_EVENTS * bumps / bumps.sum()
    reached = np.concatenate([[0.0], np.cumsum(density)])[:-1] / density[:-1].sum()
    wanted = np.interp(np.linspace(0, 1, count), reached, frames.astype(float))
    return _apart(np.round(wanted).astype(int), last)


def _moves(episode: Episode, body: Body, frames: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(N,) whether a body moves, at some frames."""
    track = episode.tracks[body.name].over(len(episode))
    position = track.position[frames].astype(np.float64)
    turn = track.orientation[frames].astype(np.float64)
    n = len(frames)
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + WINDOW - 1, n - 1)
    path = np.linalg.norm(position[after] - position[before], axis=1)
    path += LEVER * angle(turn[after], turn[before])
    span = episode.t[frames][after] - episode.t[frames][before]
    return np.asarray(path > MOVING * np.maximum(span, 1e-9))


def _changes(times: F64, on: NDArray[np.bool_]) -> list[float]:
    """When something begins and ends, pauses and short spells left out."""
    edges = np.flatnonzero(np.diff(on.astype(int)))
    result: list[float] = []
    for time in times[edges + 1].tolist():
        if result and time - result[-1] < PAUSE:
            result.pop()
        else:
            result.append(time)
    return result


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
        breaks = np.flatnonzero(np.diff(times) > PAUSE)
        starts, ends = times[np.append(0, breaks + 1)], times[np.append(breaks, len(times) - 1)]
        edge = 2 * episode.dt
        result += starts[starts > episode.t[0] + edge].tolist()
        result += ends[ends < episode.t[-1] - edge].tolist()
    return result


def _merged(events: Sequence[float]) -> F64:
    """Events that are closer to each other than their spread are one."""
    times: list[float] = []
    for time in sorted(events):
        if not times or time - times[-1] > SPREAD / 2:
            times.append(time)
    return np.array(times)


def _apart(frames: NDArray[np.intp], last: int) -> list[int]:
    """The frames without repetitions."""
    up = np.maximum.accumulate(frames - np.arange(len(frames))) + np.arange(len(frames))
    back = last - np.arange(len(frames))[::-1]
    return [int(frame) for frame in np.minimum(up, back)]
