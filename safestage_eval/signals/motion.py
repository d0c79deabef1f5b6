"""Signals of how bodies move: from poses and twists alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle, rotate

from .reference import Reference

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


def height(episode: Episode, name: str, reference: Reference | None) -> F64:
    """(T,) m, z of the COM, or its change since the reference if one is given."""
    com = com_position(episode, name)
    if reference is None or reference.since is None:
        return com[:, 2]
    return com[:, 2] - reference.of(com, reference.baseline.position(com))[:, 2]


def displacement(episode: Episode, name: str, reference: Reference, axes: int = 3) -> F64:
    """(T,) m, distance of the COM from the reference; horizontal if ``axes`` is 2."""
    com = com_position(episode, name)
    moved = com - reference.of(com, reference.baseline.position(com))
    distance: F64 = np.linalg.norm(moved[:, :axes], axis=1)
    return distance


def turn(episode: Episode, name: str, reference: Reference) -> F64:
    """(T,) rad, geodesic angle from the reference orientation."""
    orientation = episode.track(name).orientation.astype(np.float64)
    initial = reference.baseline.orientation(orientation)
    return angle(orientation, reference.of(orientation, initial))


def tilt(episode: Episode, name: str) -> F64 | None:
    """(T,) rad, angle between the declared up axis and world z; None for a body without one.

    atan2 of sine and cosine, so that a small tilt keeps its digits (arccos loses half of them).
    """
    axis = episode.bodies[name].up_axis
    if axis is None:
        return None
    up = rotate(episode.track(name).orientation, np.asarray(axis, np.float64))
    from_vertical: F64 = np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])
    return from_vertical


def speed(episode: Episode, name: str) -> F64:
    """(T,) m/s of the COM."""
    value: F64 = np.linalg.norm(com_velocity(episode, name), axis=1)
    return value


def vertical_speed(episode: Episode, name: str) -> F64:
    """(T,) m/s of the COM, up positive."""
    return com_velocity(episode, name)[:, 2]


def angular_speed(episode: Episode, name: str) -> F64:
    """(T,) rad/s."""
    track = episode.track(name)
    value: F64 = np.linalg.norm(track.angular_velocity.astype(np.float64), axis=1)
    return value


def relative_speed(episode: Episode, a: list[str], b: list[str]) -> F64:
    """(T,) m/s between the COMs; over unions, the fastest pair."""
    va, vb = ([com_velocity(episode, n) for n in names] for names in (a, b))
    pairs = [np.linalg.norm(x - y, axis=1) for x in va for y in vb]
    fastest: F64 = np.maximum.reduce(pairs)
    return fastest
