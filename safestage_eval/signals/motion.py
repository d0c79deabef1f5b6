"""Signals of how bodies move: from poses and twists alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle, rotate

from .facts import Query
from .series import Series, exact

F64 = NDArray[np.float64]


def com_position(episode: Episode, name: str) -> F64:
    """(T, 3) m, centre of mass, world."""
    track = episode.track(name)
    offset = np.asarray(episode.bodies[name].com, np.float64)
    position = track.position.astype(np.float64)
    return position + rotate(track.orientation, offset) if offset.any() else position


def com_velocity(episode: Episode, name: str) -> F64:
    """(T, 3) m/s, velocity of the centre of mass, world: v + ω × (c − o)."""
    track = episode.track(name)
    offset = np.asarray(episode.bodies[name].com, np.float64)
    velocity = track.linear_velocity.astype(np.float64)
    if not offset.any():
        return velocity
    arm = rotate(track.orientation, offset)
    return velocity + np.cross(track.angular_velocity.astype(np.float64), arm)


def height(query: Query) -> Series:
    """m, z of the COM, or its change since the reference if one is given."""
    com = com_position(query.episode, query.bodies[0])
    if query.since is None or query.since.since is None:
        return exact(com[:, 2], query.dimension)
    initial = query.since.baseline.position(com)
    return exact(com[:, 2] - query.since.of(com, initial)[:, 2], query.dimension)


def displacement(query: Query) -> Series:
    """m, distance of the COM from the reference; horizontal for ``displacement_xy``."""
    com, reference = com_position(query.episode, query.bodies[0]), query.reference
    moved = com - reference.of(com, reference.baseline.position(com))
    axes = 2 if query.name.endswith("xy") else 3
    return exact(np.linalg.norm(moved[:, :axes], axis=1), query.dimension)


def turn(query: Query) -> Series:
    """rad, geodesic angle from the reference orientation."""
    orientation = query.episode.track(query.bodies[0]).orientation.astype(np.float64)
    initial = query.reference.baseline.orientation(orientation)
    return exact(angle(orientation, query.reference.of(orientation, initial)), query.dimension)


def tilt(query: Query) -> Series:
    """rad, angle between the declared up axis and world z.

    atan2 of sine and cosine, so that a small tilt keeps its digits (arccos loses half of them).
    """
    name = query.bodies[0]
    axis = query.episode.bodies[name].up_axis
    if axis is None:  # below every upper limit and above no lower one: skipped
        note = f"{name} has no up axis: its tilt is not judged"
        return exact(np.full(len(query.episode), -np.inf), query.dimension, (note,))
    up = rotate(query.episode.track(name).orientation, np.asarray(axis, np.float64))
    return exact(np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2]), query.dimension)


def speed(query: Query) -> Series:
    """m/s of the COM."""
    velocity = com_velocity(query.episode, query.bodies[0])
    return exact(np.linalg.norm(velocity, axis=1), query.dimension)


def vertical_speed(query: Query) -> Series:
    """m/s of the COM, up positive."""
    return exact(com_velocity(query.episode, query.bodies[0])[:, 2], query.dimension)


def angular_speed(query: Query) -> Series:
    """rad/s."""
    velocity = query.episode.track(query.bodies[0]).angular_velocity.astype(np.float64)
    return exact(np.linalg.norm(velocity, axis=1), query.dimension)


def relative_speed(query: Query) -> Series:
    """m/s between the COMs; over unions, the fastest pair."""
    first, second = ([com_velocity(query.episode, n) for n in names] for names in query.groups)
    pairs = [np.linalg.norm(a - b, axis=1) for a in first for b in second]
    return exact(np.maximum.reduce(pairs), query.dimension)
