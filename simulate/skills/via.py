"""Carry what is held through points in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .arm_motion import TRAVEL_SPEED, Actions, Motion


def via(
    motion: Motion,
    points: Sequence[Sequence[float]],
    near: str | None = None,
    speed: float = TRAVEL_SPEED,
    pause: float = 0.0,
) -> Actions:
    """Bring the held object (or the empty TCP) through points, in straight lines.

    Args:
        points: of the object's origin, from the table's frame or from ``near``'s origin.
        near: name of an object.
        speed: m/s.
        pause: s at each point.
    """
    origin = np.zeros(3) if near is None else motion.state.object_pose(near)[0]
    for point in points:
        yield from motion.carry(origin + np.asarray(point, float), speed=speed)
        yield from motion.hold(pause)
