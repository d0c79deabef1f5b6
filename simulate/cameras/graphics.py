"""A place to draw without a screen."""

from __future__ import annotations

import importlib
import os
from typing import Any

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
