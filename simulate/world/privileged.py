"""The door to what only references may see: the true state of the world.

Policies get observations; a reference is handed a ``PrivilegedState`` as well, and nothing else in
this package passes it on.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from simulate.arm.droid import HOME
from simulate.catalogue.objects import ObjectModel

from .world import World

F64 = NDArray[np.float64]

TOLERANCE = (2e-4, 2e-3)
"""m and rad at which inverse kinematics has arrived."""
DAMPING = 1e-3
POSTURE = 0.05
"""Pull of the null space towards home."""


class PrivilegedState:
    """True poses, and the inverse kinematics of the arm."""

    def __init__(self, world: World) -> None:
        """Look into a world; nothing of it is changed."""
        self._world = world
        self._scratch = mujoco.MjData(world.model)

    @property
    def arm_position(self) -> F64:
        """(7,) rad, measured."""
        return self._world.arm_position

    @property
    def tcp(self) -> tuple[F64, F64]:
        """Position (3,) m and rotation (3, 3) of the tool centre point, world."""
        data = self._world.data
        tcp = self._world.tcp
        return data.site_xpos[tcp].copy(), data.site_xmat[tcp].reshape(3, 3).copy()

    def object_pose(self, name: str) -> tuple[F64, F64]:
        """Position (3,) m of an object's origin and rotation (3, 3), object to world."""
        data, body = self._world.data, self._world.body_id[name]
        return data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()

    def model(self, name: str) -> ObjectModel:
        """Model of an object."""
        return self._world.objects[name]

    def names(self) -> list[str]:
        """All objects."""
        return list(self._world.objects)

    def inverse_kinematics(self, position: F64, rotation: F64, start: F64) -> tuple[F64, float]:
        """Joint positions that bring the TCP to a pose, by damped least squares.

        Args:
            position: (3,) m, world.
            rotation: (3, 3), TCP to world.
            start: (7,) rad, where the search begins.

        Returns:
            (7,) rad within the joints' limits, and the remaining position error (m).

        Source: Nakamura & Hanafusa, "Inverse kinematic solutions with singularity robustness",
        J. Dyn. Sys. 108, 1986; the null space is used to stay near the home posture.
        """
        world, data = self._world, self._scratch
        model = world.model
        data.qpos[:] = world.data.qpos
        q = start.copy()
        jacobian, error = np.zeros((6, model.nv)), np.zeros(6)
        target, current, inverse, off = (np.zeros(4) for _ in range(4))
        mujoco.mju_mat2Quat(target, np.ascontiguousarray(rotation).ravel())
        for _ in range(60):
            data.qpos[world.arm_qpos] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            error[:3] = position - data.site_xpos[world.tcp]
            mujoco.mju_mat2Quat(current, data.site_xmat[world.tcp])
            mujoco.mju_negQuat(inverse, current)
            mujoco.mju_mulQuat(off, target, inverse)
            mujoco.mju_quat2Vel(error[3:], off, 1.0)
            if (
                np.linalg.norm(error[:3]) < TOLERANCE[0]
                and np.linalg.norm(error[3:]) < TOLERANCE[1]
            ):
                break
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], world.tcp)
            J = jacobian[:, world.arm_dof]
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), error)
            step += (np.eye(7) - np.linalg.pinv(J) @ J) @ (POSTURE * (HOME - q))
            low, high = world.arm_range.T
            q = np.clip(q + np.clip(step, -0.2, 0.2), low, high)
        return q, float(np.linalg.norm(error[:3]))
