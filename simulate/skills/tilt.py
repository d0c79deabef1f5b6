"""Tip what is held, as one pours."""

from __future__ import annotations

import numpy as np

from safestage_eval.errors import InputError

from .arm_motion import Actions, Motion, rotation_matrix


def tilt(
    motion: Motion,
    angle: float,
    direction: float = 0.0,
    facing: str = "world",
    pause: float = 0.0,
) -> Actions:
    """Turn the gripper about a horizontal axis through the TCP, and what it holds with it.

    Args:
        angle: how far the top goes over; negative brings it back.
        direction: in which the top goes, about z.
        facing: what ``direction`` counts from: the ``world``'s x, or the held ``object``'s own
            heading.
        pause: s to stay there.
    """
    if facing not in ("world", "object"):
        raise InputError("skill 'tilt'", f"facing {facing!r}.", "world, object")
    heading = np.radians(direction)
    if facing == "object":
        if motion.held is None:
            raise InputError("skill 'tilt'", "facing = 'object', but nothing is held.")
        _, turned = motion.state.object_pose(motion.held)
        heading += np.arctan2(turned[1, 0], turned[0, 0])
    axis = np.array([-np.sin(heading), np.cos(heading), 0.0])
    goal = rotation_matrix(np.radians(angle) * axis) @ motion.rotation
    yield from motion.move(motion.position, goal, settle=0.3)
    yield from motion.hold(pause)
