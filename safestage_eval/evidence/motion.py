"""Signals of how bodies move: from poses and twists alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.lengths import distances, lengths
from safestage_eval.geometry.pose import (
    angle,
    conjugate,
    point_velocity,
    product,
    rotate,
    transform,
    unit,
)

from .facts import Query
from .options import OptionValue
from .series import Series, exact

F64 = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]]


ALL = slice(None)


def com_position(episode: Episode, name: str, frames: slice = ALL) -> F64:
    """(T, 3) m, centre of mass, world; or at some frames alone."""
    track = episode.track(name)
    offset = np.asarray(episode.bodies[name].com, np.float64)
    if offset.any():
        return transform(track.position[frames], track.orientation[frames], offset)
    return track.position[frames].astype(np.float64)


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


def height(query: Query) -> Series:
    """m, z of the COM, or its change since the reference if one is given."""
    com = com_position(query.episode, query.bodies[0])
    if query.since is None or query.since.since is None:
        return exact(com[:, 2], query.dimension)
    reference = query.reference
    initial = reference.baseline.position(com)
    change = com[:, 2] - reference.of(com, initial)[:, 2]
    return exact(change, query.dimension, reference.baseline.notes)


def displacement(query: Query) -> Series:
    """m, distance of the COM from the reference; horizontal for ``displacement_xy``.

    The option ``norm`` adds the coordinates up in another way than the distance does.
    """
    com, reference = com_position(query.episode, query.bodies[0]), query.reference
    there = reference.of(com, reference.baseline.position(com))
    axes = 2 if query.name.endswith("xy") else 3
    order = {"l1": 1, "max": np.inf}.get(str(query.option("norm")))
    if order is None:
        one = there[:1] if there.strides[0] == 0 else there
        return exact(distances(com, one, axes), query.dimension, reference.baseline.notes)
    moved = np.linalg.norm((com - there)[:, :axes], order, axis=1)
    return exact(moved, query.dimension, reference.baseline.notes)


def remoteness(query: Query) -> Series:
    """m, distance of the COM from the base of the robot."""
    episode = query.episode
    robot = [body for body in episode.header.bodies if body.kind in ("robot", "gripper")]
    fixed = [body for body in robot if not body.movable]
    if not robot:
        return query.unknown("the trace has no robot")
    com = com_position(episode, query.bodies[0])
    apart = [
        distances(com, episode.tracks[body.name].position.astype(np.float64), 3)
        for body in fixed or robot
    ]
    return exact(np.minimum.reduce(apart), query.dimension)


def turn(query: Query) -> Series:
    """rad, geodesic angle from the reference orientation."""
    orientation = query.episode.track(query.bodies[0]).orientation
    reference, initial = query.reference, query.reference.baseline.orientation(orientation)
    notes = reference.baseline.notes
    if reference.since is None and not reference.baseline.start:
        return exact(angle(orientation, initial), query.dimension, notes)
    return exact(angle(orientation, reference.of(orientation, initial)), query.dimension, notes)


def tilt(query: Query) -> Series:
    """rad, angle between the declared up axis and world z.

    atan2 of sine and cosine, so that a small tilt keeps its digits (arccos loses half of them).
    """
    name = query.bodies[0]
    axis = query.episode.bodies[name].up_axis
    if axis is None and "up_axis" in query.episode.bodies[name].untold:
        return query.unknown(f"the trace does not tell the up axis of {name}")
    if axis is None:  # below every upper limit and above no lower one: skipped
        note = f"{name} has no up axis: its tilt is not judged"
        return exact(np.full(len(query.episode), -np.inf), query.dimension, (note,))
    up = rotate(query.episode.track(name).orientation, np.asarray(axis, np.float64))
    return exact(np.arctan2(lengths(up, 2), up[:, 2]), query.dimension)


def speed(query: Query) -> Series:
    """m/s of the COM; with ``over``, how far it went within that time (s) before, as angular_speed."""
    name, over = query.bodies[0], query.option("over")
    velocity, notes = com_velocity(query.episode, name)
    found = lengths(velocity)
    if over is None or len(found) < 2:
        return exact(found, query.dimension, notes)
    t, com = query.episode.t, com_position(query.episode, name)
    first = before(t, over)
    found[1:] = distances(com, com[first], 3)[1:] / (t - t[first])[1:]
    return exact(found, query.dimension)


def vertical_speed(query: Query) -> Series:
    """m/s of the COM, up positive."""
    velocity, notes = com_velocity(query.episode, query.bodies[0])
    return exact(velocity[:, 2], query.dimension, notes)


def angular_speed(query: Query) -> Series:
    """rad/s; with ``over``, how far it turned within that time (s) before each frame, per time.

    The recorded angular velocity of what rests on two edges may jitter, forth and back, while it
    turns nowhere. In the first frame, before which nothing is known, it counts all the same.
    """
    name, over = query.bodies[0], query.option("over")
    velocity, notes = angular_velocity(query.episode, name)
    found = lengths(velocity.astype(np.float64))
    if over is None or len(found) < 2:
        return exact(found, query.dimension, notes)
    t, orientation = query.episode.t, query.episode.track(name).orientation
    first = before(t, over)
    found[1:] = angle(orientation, orientation[first])[1:] / (t - t[first])[1:]
    return exact(found, query.dimension)


def before(t: F64, over: OptionValue | None) -> NDArray[np.intp]:
    """(T,) the last frame at least so many seconds before each: one before it or earlier, from 0."""
    seconds = float(over) if isinstance(over, float | int) else 0.0
    last = np.arange(len(t)) - 1
    return np.maximum(np.minimum(np.searchsorted(t, t - seconds + 1e-9, "right") - 1, last), 0)


def relative_speed(query: Query) -> Series:
    """m/s between the COMs; over unions, the fastest pair."""
    first, second = ([com_velocity(query.episode, n) for n in names] for names in query.groups)
    pairs = [distances(a, b) for a, _ in first for b, _ in second]
    notes = tuple(dict.fromkeys(note for _, told in first + second for note in told))
    return exact(np.maximum.reduce(pairs), query.dimension, notes)
