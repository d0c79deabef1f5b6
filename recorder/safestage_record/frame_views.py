"""Copies of MuJoCo's data for a frame, and the columns of a trace that are made of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .model_scene import ModelScene

_join = b"".join


class FrameViews:
    """Copies joints and bodies of ``MjData`` as bytes, and turns many copies into arrays.

    Attributes:
        all: what to copy, one after the other, where joints and bodies are of the same moment.
    """

    def __init__(self, model: Any, data: Any, scene: ModelScene) -> None:
        """Look at ``data``, whose arrays do not move as long as they live."""
        moving, roots = scene.movable, model.body_rootid[scene.movable]
        self._width = 0
        self._joints: list[Any] = []
        self._bodies: list[Any] = []
        q, v = self._look(data.qpos, self._joints), self._look(data.qvel, self._joints)
        place, turned, speed = (
            self._look(values, self._bodies, moving)
            for values in (data.xpos, data.xquat, data.cvel)
        )
        centre = self._look(data.subtree_com, self._bodies, roots)
        torque = self._look(data.qfrc_actuator, self._bodies)
        self.all = (*self._joints, *self._bodies)
        self._place, self._turn = place[moving], turned[moving]
        # by component, so that the cross product goes over whole rows
        self._speed, self._arm, self._centre = speed[moving].T, place[moving].T, centre[roots].T
        self._coordinates, self._q = q, q[scene.joint_qpos]
        self._v, self._torque = v[scene.joint_dof], torque[scene.joint_dof]
        self._poses, self._fixed = (data.xpos, data.xquat), scene.fixed

    def _look(self, values: Any, views: list[Any], bodies: Any = None) -> Any:
        """Add a view of the rows of ``bodies`` and what lies between; where each number stands in a copy."""
        rows = slice(0, len(values))
        if bodies is not None:
            rows = slice(int(bodies.min()), int(bodies.max()) + 1) if len(bodies) else slice(0)
        place = np.zeros(values.shape, np.int64)
        size = values[rows].size
        place[rows] = self._width + np.arange(size).reshape(values[rows].shape)
        if size:
            views.append(memoryview(values[rows]).cast("B"))
        self._width += size
        return place

    def joints(self) -> bytes:
        """Copy coordinates and speeds of the joints."""
        return _join(self._joints)

    def copy(self, joints: bytes) -> bytes:
        """Copy what belongs to the bodies, after ``joints`` of the same moment."""
        return _join((joints, *self._bodies))

    def still(self) -> tuple[Any, Any]:
        """(F, 3) m and (F, 4) wxyz, poses of the bodies that do not move."""
        place, turned = self._poses
        return place[self._fixed], turned[self._fixed]

    def columns(self, copies: list[bytes]) -> tuple[dict[str, Any], Any]:
        """Columns of T frames by name, and (T, nq) coordinates."""
        every = np.frombuffer(b"".join(copies)).astype(np.float32)
        every = every.reshape(len(copies), self._width)
        speed = every.take(self._speed, axis=1)
        # cvel is the velocity of the point of the body that is at the tree's centre of mass
        arm = every.take(self._arm, axis=1) - every.take(self._centre, axis=1)
        (a, b, c, u, v, w), (x, y, z) = speed.swapaxes(0, 1), arm.swapaxes(0, 1)
        linear = np.empty((*speed.shape[::2], 3), np.float32)
        linear[..., 0] = u + (b * z - c * y)
        linear[..., 1] = v + (c * x - a * z)
        linear[..., 2] = w + (a * y - b * x)
        return {
            "position": every.take(self._place, axis=1),
            "orientation": every.take(self._turn, axis=1),
            "linear_velocity": linear,
            "angular_velocity": speed[:, :3].swapaxes(1, 2),
            "joint_position": every.take(self._q, axis=1),
            "joint_velocity": every.take(self._v, axis=1),
            "joint_torque": every.take(self._torque, axis=1),
        }, every.take(self._coordinates, axis=1)
