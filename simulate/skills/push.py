"""Push an object along the table."""

from __future__ import annotations

import numpy as np

from .arm_motion import Actions, Motion, up


def push(
    motion: Motion,
    object: str,  # noqa: A002
    direction: float,
    distance: float,
    height: float = 0.03,
    standoff: float = 0.08,
    speed: float = 0.10,
    rise: float = 0.0,
    pitch: float = 0.0,
) -> Actions:
    """Push an object over the table with the closed fingers.

    Args:
        object: its name.
        direction: deg about z, world.
        distance: how far the fingers end beyond the object's first origin.
        height: of the fingertips above the table.
        standoff: from the object's origin, where the push begins.
        speed: m/s.
        rise: how far the fingertips rise on the way; a tenth of the way keeps them from jamming the
            object against the table.
        pitch: 0 with the hand above its fingers, 90 behind them, to push tall objects low.
    """
    position, _ = motion.state.object_pose(object)
    angle = np.radians(direction)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    start = position - standoff * along
    start[2] = height
    goal = motion.grasp_rotation(angle, np.radians(pitch))
    yield from motion.grip(True, 0.2)
    yield from motion.move(start + up(0.12), goal)
    yield from motion.move(start, goal, speed=0.15, settle=0.2)
    yield from motion.move(start + (standoff + distance) * along + up(rise), goal, speed=speed)
    yield from motion.move(motion.position - 0.15 * goal[:, 2], goal)
    yield from motion.grip(False, 0.2)
