"""Take hold of an object and lift it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.errors import InputError

from .arm_motion import Actions, Motion, rotation_matrix, up

GRASP_TIME = 0.7
"""s that the gripper takes to close on something."""


def pick(
    motion: Motion,
    object: str,  # noqa: A002 - the word that task files use
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    yaw: float = 0.0,
    pitch: float = 0.0,
    roll: float = 0.0,
    facing: str = "object",
    approach: float = 0.10,
    lift: float = 0.12,
) -> Actions:
    """Go in front of an object, move in along the approach direction, close, lift.

    Args:
        object: its name.
        offset: TCP from the object's origin, in the object's axes turned about z only.
        yaw: of the approach about z; at 0 the fingers close along the frame's y.
        pitch: 0 from above, 90 from the side.
        roll: of the gripper about the horizontal heading, for leaning objects; positive moves the palm
            to the right of the heading.
        facing: what ``yaw`` and ``offset`` count from: the ``object``'s own heading, or
            ``outward`` from the robot's base through the object (round things).
        approach: distance at which the last straight move begins.
        lift: how far to raise the held object.
    """
    position, rotation = motion.state.object_pose(object)
    if facing not in ("object", "outward"):
        raise InputError("skill 'pick'", f"facing {facing!r}.", "object, outward")
    axis = rotation[:2, 0] if facing == "object" else position[:2]
    heading = np.arctan2(axis[1], axis[0])
    c, s = np.cos(heading), np.sin(heading)
    at = position + np.array([c * offset[0] - s * offset[1], s * offset[0] + c * offset[1], 0])
    at[2] += offset[2]
    goal = motion.grasp_rotation(heading + np.radians(yaw), np.radians(pitch))
    along = np.array([np.cos(heading + np.radians(yaw)), np.sin(heading + np.radians(yaw)), 0.0])
    goal = rotation_matrix(np.radians(roll) * along) @ goal
    yield from motion.move(at - approach * goal[:, 2], goal)
    yield from motion.move(at, goal, speed=0.12, settle=0.3)
    yield from motion.grip(True, GRASP_TIME)
    motion.held = object
    if lift:
        yield from motion.move(motion.position + up(lift), goal, speed=0.15)
