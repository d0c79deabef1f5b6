"""Drawing without a screen: the OpenGL context, and pictures of ids in place of colours."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.closing import Closing
from safestage_eval.errors import InputError


def graphics_context(width: int, height: int) -> Any:
    """An off-screen OpenGL context of the kind that ``MUJOCO_GL`` names, EGL if none.

    Raises InputError where nothing can be drawn off screen.
    """
    wanted = os.environ.get("MUJOCO_GL", "egl").lower()
    if wanted not in ("egl", "osmesa", "glfw"):
        raise InputError("MUJOCO_GL", f"{wanted!r} cannot draw off screen.", "egl, osmesa, glfw")
    os.environ.setdefault("PYOPENGL_PLATFORM", wanted)
    try:
        return importlib.import_module(f"mujoco.{wanted}").GLContext(width, height)
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        raise InputError(
            "rendering",
            f"no graphics context ({wanted}: {error}).",
            "MUJOCO_GL=egl or MUJOCO_GL=osmesa",
            "apt-get install libegl1 libgl1-mesa-dri libosmesa6",
        ) from error


class Canvas(Closing):
    """Draws one model off screen: set ``scene`` up, then ``draw`` it. One at a time per process.

    Attributes:
        scene: what is drawn.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Raises InputError where nothing can be drawn off screen."""
        self._context = graphics_context(width, height)
        self._context.make_current()
        self.scene = mujoco.MjvScene(model, maxgeom=4000)
        self._target = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._target)
        self._rect = mujoco.MjrRect(0, 0, width, height)

    def make_current(self) -> None:
        """Draw here from now on, in this thread."""
        self._context.make_current()

    def draw(self) -> NDArray[np.uint8]:
        """(H, W, 3) the picture of the scene."""
        out = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_render(self._rect, self.scene, self._target)
        mujoco.mjr_readPixels(out, None, self._rect, self._target)
        return np.ascontiguousarray(out[::-1])

    def close(self) -> None:
        """Give the graphics context back."""
        self._target.free()
        self._context.free()


@contextmanager
def drawing_ids(scene: mujoco.MjvScene) -> Iterator[None]:
    """Draw each geom of a scene in the colour of its id while the context lasts; see ``ids_of``."""
    flags = scene.flags
    kinds = (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR)
    before = [int(flags[kind]) for kind in kinds]
    for kind in kinds:
        flags[kind] = 1
    try:
        yield
    finally:
        for kind, flag in zip(kinds, before, strict=True):
            flags[kind] = flag


def ids_of(image: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(H, W) index into the scene's geoms, -1 for none, of a picture (H, W, 3) drawn by ids."""
    ids: NDArray[np.int64] = image.astype(np.int64) @ np.array([1, 256, 65536]) - 1
    return ids
