"""Touches, and peaks of forces, that two samples may hide between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.contact_sums import ONE_STEP
from safestage_eval.evidence.missing_values import TWIST
from safestage_eval.evidence.motion import derived
from safestage_eval.evidence.series import Series
from safestage_eval.geometry.group_clearance import motion_bound
from safestage_eval.geometry.mover import Mover

if TYPE_CHECKING:
    from .support_facts import Support

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]


def may_touch_between(relations: Support, a: str, b: str, where: Bool) -> Bool:
    """(T,) where two bodies or unions may come to touch after a sample and before the next.

    If they are d and e apart at two samples and their distance changes by m at most on the way, they
    come no nearer than (d + e − m) / 2. m is the way from pose to pose, or that of the recorded
    velocities over the time between, whichever is longer: what comes and goes again ends where it
    began. Without shapes nothing bounds how near they came.

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
                out[:-1] |= _near(relations, one, other, where[:-1])
    return out


def with_missed_peaks(relations: Support, bodies: Sequence[str], recorded: Series) -> Series:
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


def _near(relations: Support, a: str, b: str, where: Bool) -> Bool:
    """(T − 1,) of two bodies, after each sample but the last."""
    movers, signals = relations.signals.movers, relations.signals
    way = motion_bound(movers[a], movers[b])
    way = np.maximum(way, _travel(relations, a) + _travel(relations, b))
    reach = float(way[where].max(initial=0.0))
    if reach <= 0:
        return np.zeros(len(way), np.bool_)
    apart = np.maximum(signals.get("clearance", (a, b), reach=reach).lower, 0.0)
    return np.asarray(where & (way > 0) & (apart[:-1] + apart[1:] <= way))


def _travel(relations: Support, name: str) -> F64:
    """(T − 1,) m, how far any point goes between two samples at the faster of their velocities.

    Where none was recorded, at the speed between these two samples, or the two before or behind them.
    """
    episode = relations.episode
    if len(episode.tracks[name]) == 1:
        return np.zeros(len(episode) - 1)
    track, mover = episode.tracks[name], relations.signals.movers[name]
    if any(derived(episode, name, column) for column in TWIST):
        fast = mover.steps / np.diff(episode.t)
        beside = np.pad(fast, 1)
        return np.asarray(np.maximum.reduce([beside[:-2], fast, beside[2:]]) * np.diff(episode.t))
    speed = _length(track.linear_velocity) + _length(track.angular_velocity) * _size(mover)
    return np.asarray(np.maximum(speed[:-1], speed[1:]) * np.diff(episode.t))


def _size(mover: Mover) -> float:
    """M, from the origin of the body's frame to its farthest point at most."""
    return float(np.linalg.norm(mover.shape.centre) + mover.shape.radius)


def _length(vectors: NDArray[np.float32]) -> F64:
    return np.asarray(np.linalg.norm(vectors.astype(np.float64), axis=1))
