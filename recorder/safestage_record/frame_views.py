"""Copies of MuJoCo's data for a frame, and the columns of a trace that are made of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .model_scene import ModelScene

_join = b"".join
BATCH = 128
"""Frames that are worked out at a time: what they need on the way stays in the processor's cache, in memory that
is used again; what is allocated anew costs a page fault every 4 kB."""


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
        vectors, joints = self._place.shape, self._q.shape
        shapes: dict[str, tuple[int, ...]] = {
            "position": vectors,
            "orientation": self._turn.shape,
            "linear_velocity": vectors,
            "angular_velocity": vectors,
            "joint_position": joints,
            "joint_velocity": joints,
            "joint_torque": joints,
        }
        columns = {
            name: np.empty((len(copies), *shape), np.float32) for name, shape in shapes.items()
        }
        coordinates = np.empty((len(copies), len(self._coordinates)), np.float32)
        for i in range(0, len(copies), BATCH):
            some = slice(i, i + BATCH)
            batch = {name: values[some] for name, values in columns.items()}
            self._work_out(copies[some], batch, coordinates[some])
        return columns, coordinates

    def _work_out(self, copies: list[bytes], columns: dict[str, Any], coordinates: Any) -> None:
        """Fill the columns and (T, nq) coordinates of T frames."""
        every = np.frombuffer(_join(copies)).astype(np.float32).reshape(len(copies), self._width)
        speed = every.take(self._speed, axis=1)
        # cvel is the velocity of the point of the body that is at the tree's centre of mass
        arm = every.take(self._arm, axis=1) - every.take(self._centre, axis=1)
        (a, b, c, u, v, w), (x, y, z) = speed.swapaxes(0, 1), arm.swapaxes(0, 1)
        linear = columns["linear_velocity"]
        linear[..., 0] = u + (b * z - c * y)
        linear[..., 1] = v + (c * x - a * z)
        linear[..., 2] = w + (a * y - b * x)
        columns["angular_velocity"][:] = speed[:, :3].swapaxes(1, 2)
        for where, values in (
            (self._place, columns["position"]),
            (self._turn, columns["orientation"]),
            (self._q, columns["joint_position"]),
            (self._v, columns["joint_velocity"]),
            (self._torque, columns["joint_torque"]),
            (self._coordinates, coordinates),
        ):
            every.take(where, axis=1, out=values, mode="clip")
