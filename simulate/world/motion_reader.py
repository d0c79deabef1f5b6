"""Poses and velocities of a MuJoCo world as a trace keeps them."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray


class MotionReader:
    """Reads where the moving bodies are and how they move.

    Attributes:
        pose: (M, 7) position (m) and orientation (wxyz) of each, body frame to world.
        twist: (M, 6) velocity of each body frame's origin (m/s) and angular velocity (rad/s), world.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, movable: NDArray[np.integer]
    ) -> None:
        """``movable``: (M,) MuJoCo ids."""
        self._data, self._movable = data, movable
        self._root = model.body_rootid[movable]
        self.pose = np.empty((len(movable), 7))
        self.twist = np.empty((len(movable), 6))

    def read(self) -> None:
        """Fill ``pose`` and ``twist`` from the data's present state."""
        data, moving = self._data, self._movable
        position, velocity = data.xpos[moving], data.cvel[moving]
        self.pose[:, :3], self.pose[:, 3:] = position, data.xquat[moving]
        # cvel is the velocity of the point of the body that is at the tree's centre of mass
        omega, twist = velocity[:, :3], self.twist
        arm = position - data.subtree_com[self._root]
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            twist[:, i] = velocity[:, 3 + i] + omega[:, j] * arm[:, k] - omega[:, k] * arm[:, j]
        twist[:, 3:] = omega
