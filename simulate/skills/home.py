"""Go back to where episodes start."""

from __future__ import annotations

from simulate.arm.droid import HOME

from .arm_motion import Actions, Motion, ease


def home(motion: Motion, seconds: float = 2.0) -> Actions:
    """Go back to where episodes start, joint by joint.

    Args:
        seconds: for the whole way.
    """
    start = motion.command
    for share in ease(seconds):
        motion.command = start + share * (HOME - start)
        yield motion.action()
    motion.position, motion.rotation = motion.state.tcp
