"""The DROID cameras, drawn off screen: two outside, one on the wrist."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Camera
from safestage_eval.errors import InputError
from simulate.arm import droid
from simulate.world.describe import body_name
from simulate.world.world import World

from .drawn_model import drawn_model
from .graphics import Canvas

F64 = NDArray[np.float64]
Image = NDArray[np.uint8]
"""(H, W, 3), red green blue."""

CAMERAS = ("exterior_left", "exterior_right", "wrist", "external")
"""Two over the robot's shoulders, one at its wrist; ``external`` is the arm model's own, on the right."""
SIZE = (180, 320)
"""Pixels: height, width."""
SHADOW = 1024
"""Pixels of a shadow's side: with MuJoCo's 4096, shadows take most of the time where there is no GPU."""


class Cameras:
    """Draws a world as it is at the moment, dressed and in a room; one at a time per process.

    What is drawn is a model of its own (``drawn_model``), into which the present joint positions are
    put: the world is not touched, and the picture is of now, where MuJoCo's poses after a step are those
    of before it.
    """

    def __init__(self, world: World, names: Sequence[str], size: tuple[int, int] = SIZE) -> None:
        """``size``: height, width. Raises InputError for a camera that there is not."""
        height, width = size
        self._ids = {name: _camera(world, name) for name in names}
        self._world, self._model = world, drawn_model(world)
        self._now = mujoco.MjData(self._model)
        self._model.vis.quality.shadowsize = SHADOW
        self._canvas = Canvas(self._model, width, height)

    def images(self) -> dict[str, Image]:
        """The current picture of each camera."""
        self._pose()
        return {name: self._image(camera) for name, camera in self._ids.items()}

    def _pose(self) -> None:
        """Put the world's present state into what is drawn."""
        model, now, world = self._model, self._now, self._world
        self._canvas.make_current()
        for name, body in world.body_id.items():  # fixed ones are put in place by their world
            there = model.body(name).id
            model.body_pos[there] = world.model.body_pos[body]
            model.body_quat[there] = world.model.body_quat[body]
        now.qpos[:], now.time = world.data.qpos, world.data.time
        mujoco.mj_kinematics(model, now)
        mujoco.mj_comPos(model, now)
        mujoco.mj_camlight(model, now)
        mujoco.mj_tendon(model, now)

    def _image(self, camera: int) -> Image:
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        option = mujoco.MjvOption()
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self._model, self._now, option, None, view, every, self._canvas.scene
        )
        return self._canvas.draw()

    def close(self) -> None:
        """Give the graphics context back."""
        self._canvas.close()


def camera_facts(world: World, names: Sequence[str], size: tuple[int, int]) -> tuple[Camera, ...]:
    """Intrinsics and places of cameras, as a trace's header has them.

    A fixed camera's pose is in the world frame, any other's in that of its body.
    """
    height, width = size
    facts = []
    for name in names:
        i = _camera(world, name)
        body = int(world.model.cam_bodyid[i])
        stands = bool(world.model.body_weldid[body] == 0)
        focal = float(height / 2 / np.tan(np.radians(world.model.cam_fovy[i]) / 2))
        position, orientation = world.model.cam_pos[i], world.model.cam_quat[i]
        if stands:
            position, orientation = _in_world(world, body, position, orientation)
        (x, y, z), (qw, qx, qy, qz) = position, orientation
        facts.append(
            Camera(
                name=name,
                width=width,
                height=height,
                fx=focal,
                fy=focal,
                cx=width / 2,
                cy=height / 2,
                body=None if stands else body_name(world.model.body(body).name),
                position=(float(x), float(y), float(z)),
                orientation=(float(qw), float(qx), float(qy), float(qz)),
            )
        )
    return tuple(facts)


def _in_world(world: World, body: int, position: F64, orientation: F64) -> tuple[F64, F64]:
    """A pose in the frame of a body that stands still, in the world's."""
    place, turn = np.empty(3), np.empty(4)
    mujoco.mju_rotVecQuat(place, position, world.data.xquat[body])
    mujoco.mju_mulQuat(turn, world.data.xquat[body], orientation)
    return place + world.data.xpos[body], turn


def _camera(world: World, name: str) -> int:
    index = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_CAMERA, droid.PREFIX + name)
    if index < 0:
        cameras = [world.model.camera(i).name for i in range(world.model.ncam)]
        there = ", ".join(camera.removeprefix(droid.PREFIX) for camera in cameras)
        raise InputError(f"camera {name!r}", "the arm's model has none of that name.", there)
    return int(index)
