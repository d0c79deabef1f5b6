"""Let go, and back out."""

from __future__ import annotations

from .arm_motion import Actions, Motion

RELEASE_TIME = 0.6
"""s that it takes to open."""


def release(motion: Motion, retreat: float = 0.10) -> Actions:
    """Open the gripper where it is, and back out along the approach direction.

    Args:
        retreat: how far to back out.
    """
    yield from motion.grip(False, RELEASE_TIME)
    motion.held = None
    if retreat:
        back = motion.position - retreat * motion.rotation[:, 2]
        yield from motion.move(back, motion.rotation, speed=0.15)
