"""Poses against velocities: what a shake may explain, and what it may not."""

import numpy as np
import pytest

from safestage_eval.doubts import contradictions
from safestage_eval.episode import Body, Episode, Header, Track

RATE = 120.0


def turning(speed: float, shake: float, phase: float = 0.0) -> tuple[np.ndarray, ...]:
    """10 s about z: at ``speed`` (rad/s), and to and fro at the rate of the recording.

    ``shake``: rad/s, the fastest of it; ``phase``: rad, where in the shake the samples are taken.
    """
    t = np.arange(0, 10, 1 / RATE)
    turn = speed * t + shake / (2 * np.pi * RATE) * np.sin(2 * np.pi * RATE * t + phase)
    rate = speed + shake * np.cos(2 * np.pi * RATE * t + phase)
    zero = np.zeros_like(t)
    pose = np.column_stack([np.cos(turn / 2), zero, zero, np.sin(turn / 2)])
    return t, pose.astype(np.float32), np.column_stack([zero, zero, rate]).astype(np.float32)


def moving(t: np.ndarray, **columns: np.ndarray) -> bool:
    """Whether the velocities of a body contradict its poses; what is not given stays."""
    still = np.zeros((len(t), 3), np.float32)
    unturned = np.tile(np.float32([1, 0, 0, 0]), (len(t), 1))
    names = ("position", "orientation", "linear_velocity", "angular_velocity")
    given = dict(zip(names, (still, unturned, still, still), strict=True)) | columns
    track = Track(*(np.asarray(given[name], np.float32) for name in names))
    body = Body(name="hand", kind="gripper")
    header = Header(episode_id="here", physics_dt=1 / RATE, frame_dt=1 / RATE, bodies=(body,))
    return bool([*contradictions(Episode(header, t, {"hand": track}))])


def contradicts(t: np.ndarray, pose: np.ndarray, velocity: np.ndarray) -> bool:
    return moving(t, orientation=pose, angular_velocity=velocity)


@pytest.mark.parametrize("speed", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
def test_a_shake_that_is_sampled_on_one_side_contradicts_nothing(speed, phase):
    assert not contradicts(*turning(speed, 0.35, phase))


@pytest.mark.parametrize("shake", [0.0, 0.35])
@pytest.mark.parametrize("factor", [-1.0, 180 / np.pi, 10.0, 0.1, np.pi / 180])
def test_another_unit_or_direction_contradicts(shake, factor):
    t, pose, velocity = turning(1.0, shake)
    assert contradicts(t, pose, velocity * np.float32(factor))


def test_the_velocity_of_another_axis_contradicts():
    t, pose, velocity = turning(1.0, 0.0)
    assert contradicts(t, pose, velocity[:, [2, 0, 1]])


def sliding(speed: float, shake: float) -> tuple[np.ndarray, ...]:
    """10 s along x at ``speed`` (m/s), shaken along z; sampled on one side of the shake, whose speed is ``shake``."""
    t = np.arange(0, 10, 1 / RATE)
    zero = np.zeros_like(t)
    place = np.column_stack([speed * t, zero, zero])
    return t, place.astype(np.float32), np.column_stack([zero + speed, zero, zero + shake])


def contradicts_place(t: np.ndarray, place: np.ndarray, velocity: np.ndarray) -> bool:
    return moving(t, position=place, linear_velocity=velocity)


@pytest.mark.parametrize("speed", [0.0, 0.02, 0.3])
def test_a_thing_that_rattles_between_fingers_contradicts_nothing(speed):
    assert not contradicts_place(*sliding(speed, 0.09))
    assert contradicts_place(*sliding(speed, 0.5))


@pytest.mark.parametrize("shake", [0.0, 0.09])
@pytest.mark.parametrize("factor", [-1.0, 100.0, 10.0, 0.1, 0.01])
def test_another_unit_or_direction_of_way_contradicts(shake, factor):
    t, place, velocity = sliding(0.3, shake)
    assert contradicts_place(t, place, velocity * factor)
