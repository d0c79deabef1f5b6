"""Put the held object down, and let go of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .arm_motion import TRAVEL_SPEED, Actions, Motion, up
from .release import release


def place(
    motion: Motion,
    on: str | None = None,
    offset: Sequence[float] = (0.0, 0.0),
    drop: float = 0.002,
    hover: float = 0.10,
    retreat: float = 0.10,
    yaw: float | None = None,
    pitch: float | None = None,
    speed: float = TRAVEL_SPEED,
) -> Actions:
    """Put the held object down, correcting on the object's own pose, and let go.

    Args:
        on: name of what it goes on or into; None for the table.
        offset: where, from that object's origin, or from the robot's base on the table. A third
            number is a height above that origin, instead of on its top or floor.
        drop: height of the object's bottom above the surface when it is let go.
        hover: height above the surface from which it is lowered.
        retreat: how far to back out afterwards, along the approach direction.
        yaw: of the approach about z, world; None keeps the present one.
        pitch: of the approach from straight down towards ``yaw``, to lay the held object down or
            stand it up; None keeps the present one.
        speed: m/s, on the way there.
    """
    target = motion.surface(on, offset)
    if yaw is not None or pitch is not None:
        heading, tip = (None if angle is None else np.radians(angle) for angle in (yaw, pitch))
        yield from motion.turn_to(heading, tip)
    yield from motion.carry(target + up(hover), speed=speed)
    yield from motion.settle_object(target + up(hover))
    yield from motion.carry(target + up(drop), speed=0.10)
    yield from motion.settle_object(target + up(drop))
    yield from release(motion, retreat)
