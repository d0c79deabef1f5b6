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
        self._data, self._movable = data, movable.astype(np.int64)
        self._root = model.body_rootid[movable].astype(np.int64)
        self.pose = np.empty((len(movable), 7))
        self.twist = np.empty((len(movable), 6))

    def read(self) -> None:
        """Fill ``pose`` and ``twist`` from the data's present state.

        MuJoCo's ``cvel`` is the velocity of the point of a body that is at its tree's centre of mass.
        """
        data, body = self._data, self._movable
        position, velocity = data.xpos[body], data.cvel[body]
        self.pose[:, :3], self.pose[:, 3:] = position, data.xquat[body]
        arm = position - data.subtree_com[self._root]
        self.twist[:, :3] = velocity[:, 3:] + np.cross(velocity[:, :3], arm)
        self.twist[:, 3:] = velocity[:, :3]
