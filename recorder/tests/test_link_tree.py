"""Links placed by their joints: where a chain's own geometry puts them, and their velocities."""

import numpy as np
import pytest

from safestage_record.link_tree import Hinge, LinkTree, Motion
from safestage_record.scene_parts import cross, multiply, turn

HINGES = {
    1: Hinge(0, (0, 0, 1), False, 0),
    2: Hinge(1, (1, 0, 0), True, 1),
    3: Hinge(2, (0, 0, 0), False, None),
}


def about(axis, angle):
    """(T, 4) wxyz turns by angles (T,) about an axis."""
    return np.concatenate([np.cos(angle / 2)[:, None], np.sin(angle / 2)[:, None] * axis], axis=1)


def chain(t):
    """A base that flies and turns, an arm of 0.5 m on a hinge, a slide along it, and a plate on its end."""
    base = np.stack([t, 0.3 * t, 1 + 0.1 * t], axis=1)
    facing = about(np.array([0.0, 0.6, 0.8]), 0.7 * t)
    joints = np.stack([np.sin(3 * t), 0.2 * np.cos(2 * t)], axis=1)
    speeds = np.stack([3 * np.cos(3 * t), -0.4 * np.sin(2 * t)], axis=1)
    arm = multiply(facing, about(np.array([0.0, 0.0, 1.0]), joints[:, 0]))
    joint = base + turn(facing, np.array([0.0, 0.0, 0.1]))
    along = np.zeros((len(t), 3))
    along[:, 0] = 0.5 + joints[:, 1]
    hand = joint + turn(arm, along)
    plate = hand + turn(arm, np.array([0.0, 0.2, 0.0]))
    tilt = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
    position = np.stack([base, joint, hand, plate], axis=1)
    orientation = np.stack([facing, arm, arm, multiply(arm, tilt)], axis=1)
    return position, orientation, joints, speeds


def test_links_are_where_their_joints_put_them_and_move_as_their_places_do():
    t = np.arange(0, 2, 1e-4)
    position, orientation, joints, speeds = chain(t)
    motion = Motion(*(np.zeros((len(t), 4, k)) for k in (3, 4, 3, 3)))
    motion.position[:, 0], motion.orientation[:, 0] = position[:, 0], orientation[:, 0]
    motion.linear[:, 0] = [1, 0.3, 0.1]
    motion.angular[:, 0] = 0.7 * np.array([0.0, 0.6, 0.8])
    LinkTree(HINGES, position[100], orientation[100], joints[100]).place(motion, joints, speeds)
    assert motion.position == pytest.approx(position, abs=1e-12)
    assert np.abs((motion.orientation * orientation).sum(axis=-1)) == pytest.approx(1, abs=1e-12)
    assert motion.linear == pytest.approx(np.gradient(position, t, axis=0, edge_order=2), abs=1e-5)
    # of a vector that turns with a link, d/dt is the cross product with its angular velocity
    fixed = turn(orientation, np.array([0.3, -0.2, 0.9]))
    change = np.gradient(fixed, t, axis=0, edge_order=2)
    assert cross(motion.angular, fixed) == pytest.approx(change, abs=1e-5)
