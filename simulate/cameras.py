"""What the arm's own cameras see, drawn off screen: the DROID arm has one outside, one on the wrist."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

from . import arm
from .graphics import graphics_context
from .world import World

Image = NDArray[np.uint8]
"""(H, W, 3), red green blue."""

CAMERAS = ("external", "wrist")
SIZE = (180, 320)
"""Pixels: height, width."""


class Cameras:
    """Draws a world that was made with ``visuals``; one at a time per process."""

    def __init__(self, world: World, names: Sequence[str], size: tuple[int, int] = SIZE) -> None:
        """``size``: height, width. Raises InputError for a camera that there is not."""
        height, width = size
        self._ids = {name: _camera(world, name) for name in names}
        self._world = world
        self._context = graphics_context(width, height)
        self._context.make_current()
        self._scene = mujoco.MjvScene(world.model, maxgeom=4000)
        self._target = mujoco.MjrContext(world.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._target)
        self._rect = mujoco.MjrRect(0, 0, width, height)

    def images(self) -> dict[str, Image]:
        """What each camera sees now."""
        return {name: self._image(camera) for name, camera in self._ids.items()}

    def _image(self, camera: int) -> Image:
        model, data = self._world.model, self._world.data
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        option = mujoco.MjvOption()
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, option, None, view, every, self._scene)
        out = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_render(self._rect, self._scene, self._target)
        mujoco.mjr_readPixels(out, None, self._rect, self._target)
        return np.ascontiguousarray(out[::-1])

    def close(self) -> None:
        """Give the graphics context back."""
        self._target.free()
        self._context.free()


def _camera(world: World, name: str) -> int:
    found = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_CAMERA, arm.PREFIX + name)
    if found < 0:
        cameras = [world.model.camera(i).name for i in range(world.model.ncam)]
        there = ", ".join(camera.removeprefix(arm.PREFIX) for camera in cameras)
        raise InputError(f"camera {name!r}", "the arm's model has none of that name.", there)
    return int(found)
