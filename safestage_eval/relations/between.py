"""Touches, and peaks of forces, that two samples may hide between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.contact_sums import ONE_STEP
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.missing_values import TWIST
from safestage_eval.evidence.motion import derived
from safestage_eval.geometry.group_clearance import clearance_series, motion_bound

from .proximity import SLACK, TOUCH

if TYPE_CHECKING:
    from safestage_eval.evidence.measure import Signals

    from .support_facts import Support

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]


def may_meet(signals: Signals, i: int, j: int) -> Bool:
    """(T,) two bodies (indices) may have come within ``TOUCH`` at the frame or since the one before.

    What has no shape may be anywhere; a mere frame touches nothing.
    """
    names = [signals.episode.header.bodies[k].name for k in (i, j)]
    if signals.movers.unseen(names):
        return np.ones(len(signals.episode), np.bool_)
    if len(signals.movers.of(names)) < len(names):
        return np.zeros(len(signals.episode), np.bool_)
    return _near(signals, names[0], names[1], TOUCH)


def may_touch_between(relations: Support, a: str, b: str, where: Bool) -> Bool:
    """(T,) where two bodies or unions may come to touch after a sample and before the next.

    Without shapes nothing bounds how near they came.

    Args:
        relations: of the episode.
        a: body or union.
        b: body or union.
        where: (T,) the samples after which it is asked for.
    """
    first, second = ([*relations.signals.bodies(name)] for name in (a, b))
    movers, frames = relations.signals.movers, len(relations.episode)
    out = np.zeros(frames, np.bool_)
    if movers.unseen([*first, *second]) or not (movers.of(first) and movers.of(second)):
        return where & (np.arange(frames) < frames - 1)
    shaped = [[n for n in names if relations.episode.bodies[n].geoms] for names in (first, second)]
    for one in shaped[0]:
        for other in shaped[1]:
            if one != other:
                out[:-1] |= where[:-1] & _near(relations.signals, one, other)[1:]
    return out


def with_missed_peaks(relations: Support, bodies: Sequence[str], recorded: Interval) -> Interval:
    """A peak force (T,), of any size where the recording may have missed one.

    That is between two samples further apart than frames are, and between any two if the peaks are
    not those of all physics steps, where the bodies may have touched in between.

    Args:
        relations: of the episode.
        bodies: names of two bodies or unions.
        recorded: as recorded.
    """
    episode = relations.episode
    if relations.blind or len(episode) < 2:
        return recorded
    where = np.ones(len(episode), np.bool_)
    if relations.signals.contact_sums.covers_frames:
        if episode.clock.uniform:
            return recorded
        where = episode.clock.spacing > ONE_STEP * episode.dt
    if episode.unseen is not None:  # nothing is known there anyway
        where &= ~episode.unseen
    where[-1] = False
    if not where.any():
        return recorded
    touching = recorded.upper > 0  # what stays in touch may be pressed harder without moving
    missed = may_touch_between(relations, bodies[0], bodies[1], where)
    missed |= where & (touching | np.append(touching[1:], False))
    if not missed.any():
        return recorded
    first = int(missed.argmax())
    note = (
        f"peak_force({', '.join(bodies)}) may have been greater between two samples, "
        f"{(episode.t[first + 1] - episode.t[first]) * 1e3:.0f} ms apart at {episode.t[first]:.2f} s"
    )
    missed[1:] |= missed[:-1]
    return replace(
        recorded, upper=np.where(missed, np.inf, recorded.upper), notes=(*recorded.notes, note)
    )


def _near(signals: Signals, a: str, b: str, touch: float = 0.0) -> Bool:
    """(T,) of two bodies with shapes: at the first sample, and after each sample but the last.

    If they are d and e apart at two samples and their distance changes by m at most on the way, they
    come no nearer than (d + e − m) / 2. m is the way from pose to pose, or that of the recorded
    velocities over the time between, whichever is longer: what comes and goes again ends where it
    began.
    """
    way = motion_bound(signals.movers[a], signals.movers[b])
    way = np.maximum(way, _travel(signals, a) + _travel(signals, b))
    most = way + 2 * touch
    reach = float(most.max(initial=0.0)) + touch
    if reach <= 0:
        return np.zeros(len(way) + 1, np.bool_)
    found = signals.measured("clearance", (a, b), None, reach, False, SLACK, ())
    apart, upper = found.lower.copy(), found.upper
    start = apart[:1] <= touch  # slack is taken from later frames only
    open_ = (apart[:-1] + apart[1:] <= most) & (upper[:-1] + upper[1:] > most)
    rows = np.append(open_, False) | np.append(False, open_)
    rows = np.flatnonzero(rows & np.isfinite(apart))
    if len(rows):
        one, other = (signals.movers[name].at(rows) for name in (a, b))
        apart[rows] = clearance_series([one], [other], reach).lower
    apart = apart if touch else np.maximum(apart, 0.0)
    return np.append(start, ((way > 0) | (touch > 0)) & (apart[:-1] + apart[1:] <= most))


def _travel(signals: Signals, name: str) -> F64:
    """(T − 1,) m, how far any point goes between two samples at the faster of their velocities.

    Where none was recorded, at the speed between these two samples, or the two before or behind them.
    """
    episode, track = signals.episode, signals.episode.tracks[name]
    seconds, mover = np.diff(episode.t), signals.movers[name]
    if len(track) == 1:
        return np.zeros(len(seconds))
    if any(derived(episode, name, column) for column in TWIST):
        beside = np.pad(mover.steps / seconds, 1)
        return np.asarray(np.maximum.reduce([beside[:-2], beside[1:-1], beside[2:]]) * seconds)
    size = float(np.linalg.norm(mover.shape.centre) + mover.shape.radius)
    straight, turning = (
        np.linalg.norm(v.astype(np.float64), axis=1)
        for v in (track.linear_velocity, track.angular_velocity)
    )
    speed = straight + turning * size
    return np.asarray(np.maximum(speed[:-1], speed[1:]) * seconds)
