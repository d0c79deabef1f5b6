"""Poses and velocities of a MuJoCo world as a trace keeps them."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


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
        """Fill ``pose`` and ``twist`` from the data's present state."""
        data = self._data
        read_motion(
            data.xpos, data.xquat, data.cvel, data.subtree_com, self._movable, self._root,
            self.pose, self.twist,
        )  # fmt: skip


@kernel
def read_motion(
    xpos: F64, xquat: F64, cvel: F64, centre: F64, movable: I64, root: I64, pose: F64, twist: F64
) -> None:
    """Fill poses (M, 7) and twists (M, 6) of moving bodies from MuJoCo's arrays over all bodies.

    ``cvel`` is the velocity of the point of the body that is at the tree's centre of mass.
    """
    for m in range(len(movable)):
        body = movable[m]
        for axis in range(4):
            pose[m, 3 + axis] = xquat[body, axis]
        for i in range(3):
            pose[m, i] = xpos[body, i]
            twist[m, 3 + i] = cvel[body, i]
            j, k = (i + 1) % 3, (i + 2) % 3
            arm_j = xpos[body, j] - centre[root[m], j]
            arm_k = xpos[body, k] - centre[root[m], k]
            moved = cvel[body, 3 + i] + cvel[body, j] * arm_k
            twist[m, i] = moved - cvel[body, k] * arm_j
