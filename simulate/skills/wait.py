"""Hold still."""

from __future__ import annotations

from .arm_motion import Actions, Motion


def wait(motion: Motion, seconds: float) -> Actions:
    """Hold still.

    Args:
        seconds: for how long.
    """
    yield from motion.hold(seconds)
