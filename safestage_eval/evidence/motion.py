"""Where the centre of mass of a body is, and how fast bodies move, derived where not recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.lengths import lengths
from safestage_eval.geometry.pose import conjugate, point_velocity, product, transform, unit

F64 = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]]


def com_position(episode: Episode, name: str) -> F64:
    """(T, 3) m, centre of mass, world."""
    track = episode.track(name)
    offset = np.asarray(episode.bodies[name].com, np.float64)
    if offset.any():
        return transform(track.position, track.orientation, offset)
    return track.position.astype(np.float64)


def com_velocity(episode: Episode, name: str) -> tuple[F64, tuple[str, ...]]:
    """(T, 3) m/s, velocity of the centre of mass, world: v + ω × (c − o); and notes on it."""
    track = episode.track(name)
    offset = np.asarray(episode.bodies[name].com, np.float64)
    velocity, notes = linear_velocity(episode, name)
    if not offset.any():
        return velocity.astype(np.float64), notes
    omega, more = angular_velocity(episode, name)
    found = point_velocity(velocity, omega, track.orientation, offset)
    return found, tuple(dict.fromkeys(notes + more))


def linear_velocity(episode: Episode, name: str) -> tuple[Numbers, tuple[str, ...]]:
    """(T, 3) m/s of the body frame's origin, world; and a note if it had to be derived.

    Where a body moves though its recorded velocity is zero throughout, none was recorded: it is
    the central difference of the positions then (one-sided in the first and last frame).
    """
    track = episode.track(name)
    if not derived(episode, name, "linear_velocity"):
        return track.linear_velocity, ()
    first, last, seconds = _neighbours(episode.t)
    position = track.position.astype(np.float64)
    return (position[last] - position[first]) / seconds[:, None], _derived(name)


def angular_velocity(episode: Episode, name: str) -> tuple[Numbers, tuple[str, ...]]:
    """(T, 3) rad/s, world; and a note if it had to be derived, as for ``linear_velocity``."""
    track = episode.track(name)
    if not derived(episode, name, "angular_velocity"):
        return track.angular_velocity, ()
    first, last, seconds = _neighbours(episode.t)
    turned = product(unit(track.orientation[last]), conjugate(unit(track.orientation[first])))
    turned = np.where(turned[:, :1] < 0, -turned, turned)  # the shorter way round
    sine = lengths(turned[:, 1:])
    size = 2 * np.arctan2(sine, turned[:, 0])
    scale = np.divide(size, sine, out=np.zeros_like(sine), where=sine > 0)
    return turned[:, 1:] * (scale / seconds)[:, None], _derived(name)


def derived(episode: Episode, name: str, column: str) -> bool:
    """A body moves, though the recorded velocity of that name is zero throughout."""
    track = episode.track(name)
    if _some(getattr(track, column)):
        return False
    return not _still(track.position if column == "linear_velocity" else track.orientation)


def _some(column: NDArray[np.float32]) -> bool:
    """Not zero throughout; ten times faster than ``any`` of numbers."""
    return bool(column.max() != 0 or column.min() != 0)


def _still(column: NDArray[np.float32]) -> bool:
    return bool((column == column[:1]).all())


def _neighbours(t: F64) -> tuple[NDArray[np.intp], NDArray[np.intp], F64]:
    """For each frame the frames before and after it (itself at the ends), and the time between."""
    at = np.arange(len(t))
    first, last = np.maximum(at - 1, 0), np.minimum(at + 1, len(t) - 1)
    return first, last, t[last] - t[first]


def _derived(name: str) -> tuple[str, ...]:
    return (f"the trace has no velocities of {name}: they are derived from its poses",)


def before(t: F64, seconds: float) -> NDArray[np.intp]:
    """(T,) the last frame at least so many seconds before each: one before it or earlier, from 0."""
    last = np.arange(len(t)) - 1
    return np.maximum(np.minimum(np.searchsorted(t, t - seconds + 1e-9, "right") - 1, last), 0)
