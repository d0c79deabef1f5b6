"""Columns recorded once per frame: joints, commands, gripper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RobotFrames:
    """Joint state and command per frame; J is the number of ``header.joints``.

    Absent columns have width 0.

    Attributes:
        joint_position: (T, J) rad or m.
        joint_velocity: (T, J) rad/s or m/s.
        joint_torque: (T, J) N m or N, by the actuators.
        action: (T, A) the command in force at the frame (held between control steps); for the
            DROID arm seven absolute joint positions (rad) and a binary gripper command (1 closed).
        gripper: (T, G) with G in {0, 1}: opening, 0 closed … 1 open.
    """

    joint_position: NDArray[np.float32]
    joint_velocity: NDArray[np.float32]
    joint_torque: NDArray[np.float32]
    action: NDArray[np.float32]
    gripper: NDArray[np.float32]

    @classmethod
    def empty(cls, frames: int) -> RobotFrames:
        """No robot recorded over so many frames."""
        return cls(*(np.zeros((frames, 0), np.float32) for _ in range(5)))
