"""Records every frame of a world completely: poses, twists, contacts, joints, commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Header
from safestage_eval.formats import CONTACT_POINT, TraceWriter

from .describe import Description
from .world import FRAME_RATE, World

F64 = NDArray[np.float64]


class Recorder:
    """Listens to a world's physics steps and writes one frame per 1/120 s.

    MuJoCo's step first computes poses, velocities, contacts and forces of the present state and
    then moves on; a frame holds what belongs to that one present moment.
    """

    def __init__(self, world: World, header: Header) -> None:
        """``header``: without bodies and joints; they are read off the world."""
        self._world = world
        self._about = about = Description(world)
        full = header.model_copy(update={"bodies": about.bodies, "joints": about.joints})
        self.writer = TraceWriter(full, meshes=about.meshes, frames=4096)
        data = world.data
        for i in about.fixed:
            name = about.bodies[i - 1].name
            self.writer.set_fixed(name, data.xpos[i].copy(), data.xquat[i].copy())
        self._root = world.model.body_rootid[about.movable]
        self._pose = np.empty((len(about.movable), 7))
        self._twist = np.empty((len(about.movable), 6))
        self._peaks: dict[int, float] = {}
        self._between: dict[int, NDArray[np.void]] = {}
        self._joints = (data.qpos[about.joint_qpos], data.qvel[about.joint_dof])
        self._opening = world.gripper_opening

    def step(self, substep: int, action: F64) -> None:
        """To be called after each physics step, with the action in force."""
        world = self._world
        points, keys, force = self._contacts()
        if world.substeps > 1:
            self._remember(points, keys, force)
        if substep == world.substeps - 1:
            self._frame(points, keys, force, action)
            self._peaks.clear()
            self._between.clear()
        self._joints = (
            world.data.qpos[self._about.joint_qpos],
            world.data.qvel[self._about.joint_dof],
        )
        self._opening = world.gripper_opening

    def _frame(self, points: NDArray[np.void], keys: F64, force: F64, action: F64) -> None:
        about, data = self._about, self._world.data
        moving = about.movable
        position, omega = data.xpos[moving], data.cvel[moving, :3]
        self._pose[:, :3], self._pose[:, 3:] = position, data.xquat[moving]
        # cvel is the velocity of the point of the body that is at the tree's centre of mass
        arm = position - data.subtree_com[self._root]
        self._twist[:, :3] = data.cvel[moving, 3:] + np.cross(omega, arm)
        self._twist[:, 3:] = omega
        if self._world.substeps > 1:
            points = self._with_peaks(points, keys)
        else:
            points["peak_force"] = _sum_by(keys, force)
        self.writer.add_frame(
            len(self.writer) / FRAME_RATE,
            self._pose,
            self._twist,
            contacts=points,
            joint_position=self._joints[0],
            joint_velocity=self._joints[1],
            joint_torque=data.qfrc_actuator[about.joint_dof],
            action=action,
            gripper=[self._opening],
        )

    def _contacts(self) -> tuple[NDArray[np.void], F64, F64]:
        """Contacts of the present step: (C,) points, (C,) keys of body pairs, (C,) N normal force."""
        model, data = self._world.model, self._world.data
        contact = data.contact
        address = contact.efc_address
        row = np.maximum(address, 0)
        rows = data.efc_force
        normal = np.where(address >= 0, rows[row] if len(rows) else 0.0, 0.0)
        keep = np.flatnonzero((address >= 0) & ((normal > 0) | (contact.dist <= 0)))
        geom, row, normal = contact.geom[keep], row[keep], normal[keep]
        frame = contact.frame[keep].reshape(-1, 3, 3)
        sideways = np.zeros((len(keep), 2))
        slides = contact.dim[keep] >= 3
        for k in (1, 2):
            sideways[slides, k - 1] = rows[row[slides] + k]
        points = np.zeros(len(keep), CONTACT_POINT)
        points["position"] = contact.pos[keep]
        points["normal"] = frame[:, 0]
        points["force"] = normal[:, None] * frame[:, 0] + np.einsum(
            "ck,ckx->cx", sideways, frame[:, 1:]
        )
        points["depth"] = -contact.dist[keep]
        points["geom1"] = self._about.geom_index[geom[:, 0]]
        points["geom2"] = self._about.geom_index[geom[:, 1]]
        body = np.sort(model.geom_bodyid[geom], axis=1)
        return points, body[:, 0] * 65536.0 + body[:, 1], normal

    def _remember(self, points: NDArray[np.void], keys: F64, force: F64) -> None:
        total = _sum_by(keys, force)
        for i in range(len(points)):
            key = int(keys[i])
            if total[i] > self._peaks.get(key, -1.0):
                self._peaks[key] = float(total[i])
                self._between[key] = points[i : i + 1]

    def _with_peaks(self, points: NDArray[np.void], keys: F64) -> NDArray[np.void]:
        """The frame's points with their pairs' peaks, and a row for pairs that touched only between."""
        points["peak_force"] = [self._peaks[int(key)] for key in keys]
        gone = [key for key in self._peaks if key not in set(keys.astype(int).tolist())]
        if not gone:
            return points
        extra = np.concatenate([self._between[key] for key in gone])
        extra["force"] = 0
        extra["peak_force"] = [self._peaks[key] for key in gone]
        return np.concatenate([points, extra])


def _sum_by(keys: F64, values: F64) -> F64:
    """(C,) for each row, the sum of ``values`` over all rows with its key."""
    if not len(keys):
        return values
    _, inverse = np.unique(keys, return_inverse=True)
    return np.bincount(inverse, values).astype(np.float64)[inverse]
