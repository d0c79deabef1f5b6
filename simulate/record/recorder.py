"""Records every frame of a world completely: poses, twists, contacts, joints, commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Header
from safestage_eval.formats import TraceWriter
from simulate.world.contact_reader import ContactReader
from simulate.world.describe import Description
from simulate.world.motion_reader import MotionReader
from simulate.world.own_facts import own_facts
from simulate.world.world import FRAME_RATE, World

F64 = NDArray[np.float64]


class Recorder:
    """Listens to a world's physics steps and writes one frame per 1/120 s.

    MuJoCo's step first computes poses, velocities, contacts and forces of the present state and
    then moves on; a frame holds what belongs to that one present moment.
    """

    def __init__(self, world: World, header: Header) -> None:
        """``header``: without bodies and joints; they are read off the world."""
        self._world = world
        self._about = about = Description(world.model, own_facts(world))
        full = header.model_copy(update={"bodies": about.bodies, "joints": about.joints})
        self.writer = TraceWriter(full, meshes=about.meshes, frames=4096)
        data = world.data
        for i in about.fixed:
            name = about.body(i).name
            self.writer.set_fixed(name, data.xpos[i].copy(), data.xquat[i].copy())
        self._contacts = ContactReader(world.model, data, about.geom_index)
        self._motion = MotionReader(world.model, data, about.movable)
        self._look()

    def step(self, substep: int, action: F64) -> None:
        """To be called after each physics step, with the action in force."""
        remaining = self._world.substeps - 1 - substep
        if remaining:
            self._contacts.between()
        else:
            self._frame(action)
        if remaining <= 1:
            self._look()

    def _look(self) -> None:
        """Joints and gripper as they are now: the present moment of the physics step to come."""
        data, about = self._world.data, self._about
        self._joints = (data.qpos[about.joint_qpos], data.qvel[about.joint_dof])
        self._opening = self._world.gripper_opening

    def _frame(self, action: F64) -> None:
        about, data = self._about, self._world.data
        self._motion.read()
        self.writer.add_frame(
            len(self.writer) / FRAME_RATE,
            self._motion.pose,
            self._motion.twist,
            contacts=self._contacts.frame(),
            joint_position=self._joints[0],
            joint_velocity=self._joints[1],
            joint_torque=data.qfrc_actuator[about.joint_dof],
            action=action,
            gripper=[self._opening],
        )
