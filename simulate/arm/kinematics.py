"""Kinematics of the arm: where commands bring the gripper, and which commands bring it somewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .droid import HOME, JOINTS, PREFIX, TCP_SITE, arm_spec

F64 = NDArray[np.float64]

TOLERANCE = (2e-4, 2e-3)
"""m and rad at which inverse kinematics has arrived."""
DAMPING = 1e-3
POSTURE = 0.05
"""Pull of the null space towards home."""


@dataclass(frozen=True)
class ArmInModel:
    """The arm's places in a MuJoCo model."""

    model: mujoco.MjModel
    qpos: Sequence[int] | NDArray[np.int64]
    """(7,) addresses of the joints' positions."""
    dof: Sequence[int] | NDArray[np.int64]
    """(7,) addresses of their velocities."""
    range: F64
    """(7, 2) rad."""
    tcp: int
    """The site at the tool centre point."""

    @classmethod
    def of(cls, model: mujoco.MjModel) -> ArmInModel:
        """Find the arm in a model by its names."""
        joints = [model.joint(name) for name in JOINTS]
        return cls(
            model,
            np.array([joint.qposadr[0] for joint in joints]),
            np.array([joint.dofadr[0] for joint in joints]),
            np.array([joint.range for joint in joints]),
            model.site(TCP_SITE).id,
        )

    def inverse(
        self, scratch: mujoco.MjData, position: F64, rotation: F64, start: F64
    ) -> tuple[F64, float]:
        """Joint positions that bring the TCP to a pose, by damped least squares.

        Args:
            scratch: its ``qpos`` says where everything but the arm is; it is overwritten.
            position: (3,) m, world.
            rotation: (3, 3), TCP to world.
            start: (7,) rad, where the search begins.

        Returns:
            (7,) rad within the joints' limits, and the remaining position error (m).

        Source: Nakamura & Hanafusa, "Inverse kinematic solutions with singularity robustness",
        J. Dyn. Sys. 108, 1986; the null space is used to stay near the home posture.
        """
        model, data = self.model, scratch
        q = start.copy()
        jacobian, error = np.zeros((6, model.nv)), np.zeros(6)
        target, current, inverse, off = (np.zeros(4) for _ in range(4))
        mujoco.mju_mat2Quat(target, np.ascontiguousarray(rotation).ravel())
        for _ in range(60):
            data.qpos[self.qpos] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            error[:3] = position - data.site_xpos[self.tcp]
            mujoco.mju_mat2Quat(current, data.site_xmat[self.tcp])
            mujoco.mju_negQuat(inverse, current)
            mujoco.mju_mulQuat(off, target, inverse)
            mujoco.mju_quat2Vel(error[3:], off, 1.0)
            if (
                np.linalg.norm(error[:3]) < TOLERANCE[0]
                and np.linalg.norm(error[3:]) < TOLERANCE[1]
            ):
                break
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self.tcp)
            J = jacobian[:, self.dof]
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), error)
            step += (np.eye(7) - np.linalg.pinv(J) @ J) @ (POSTURE * (HOME - q))
            low, high = self.range.T
            q = np.clip(q + np.clip(step, -0.2, 0.2), low, high)
        return q, float(np.linalg.norm(error[:3]))


class ArmAlone:
    """The arm without a scene: all that a policy may compute kinematics with."""

    def __init__(self) -> None:
        """Compile the bundled arm. Its base is the world's origin, as in every scene."""
        spec = mujoco.MjSpec()
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # as the arm's own
        spec.worldbody.add_frame().attach_body(arm_spec().body("link0"), PREFIX, "")
        self._arm = ArmInModel.of(spec.compile())
        self._data = mujoco.MjData(self._arm.model)

    def tcp(self, joints: F64) -> tuple[F64, F64]:
        """Position (3,) m and rotation (3, 3) of the TCP at joint positions (7,) rad."""
        data, arm = self._data, self._arm
        data.qpos[arm.qpos] = joints
        mujoco.mj_kinematics(arm.model, data)
        return data.site_xpos[arm.tcp].copy(), data.site_xmat[arm.tcp].reshape(3, 3).copy()

    def joints(self, position: F64, rotation: F64, start: F64) -> tuple[F64, float]:
        """Joint positions (7,) rad at a pose of the TCP, and the position error left (m).

        Args:
            position: (3,) m, in the frame of the arm's base.
            rotation: (3, 3), TCP to base.
            start: (7,) rad, where the search begins.
        """
        return self._arm.inverse(self._data, position, rotation, start)
