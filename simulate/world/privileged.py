"""The door to what only references may see: the true state of the world.

Policies get observations; a reference is handed a ``PrivilegedState`` as well, and nothing else in
this package passes it on.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from simulate.arm.kinematics import ArmInModel
from simulate.catalogue.objects import ObjectModel

from .world import World

F64 = NDArray[np.float64]


class PrivilegedState:
    """True poses, and the inverse kinematics of the arm."""

    def __init__(self, world: World) -> None:
        """Look into a world; nothing of it is changed."""
        self._world = world
        self._scratch = mujoco.MjData(world.model)
        self._arm = ArmInModel.of(world.model)

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
        """Joint positions that bring the TCP to a pose (see ``ArmInModel.inverse``)."""
        self._scratch.qpos[:] = self._world.data.qpos
        return self._arm.inverse(self._scratch, position, rotation, start)
