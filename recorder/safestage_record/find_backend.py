"""Finds the simulation that an environment holds, and the recorder for it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from .mujoco_recorder import MujocoRecorder
from .pybullet_recorder import PyBulletRecorder
from .record_error import RecordError
from .rollout_recorder import RolloutRecorder
from .sapien_recorder import SapienRecorder

_INSIDE = ("unwrapped", "env", "_env", "sim", "physics", "_physics", "_sim", "task", "_p", "p")
_CLIENTS = ("_physics_client_id", "physicsClientId", "physics_client", "_client", "client", "cid")


def begin_recording(env: Any, path: Path, **settings: Any) -> RolloutRecorder:
    """Begin to record what an environment simulates; settings as of the simulator's recorder.

    Raises:
        RecordError: no simulation is found, or the recorder refuses it.
    """
    kind, found = find_backend(env)
    if kind == "mujoco":
        model, data = found
        return MujocoRecorder(model, data, path, **settings)
    if kind == "sapien":
        return SapienRecorder(found, path, **settings)
    return PyBulletRecorder(found, path, **settings)


def find_backend(env: Any) -> tuple[str, Any]:
    """Return mujoco and (model, data), sapien and the scene, or pybullet and the number of the client.

    Raises:
        RecordError: there is none of them.
    """
    for here in _inside(env):
        if "mujoco" in sys.modules:
            found = _mujoco(here)
            if found is not None:
                return "mujoco", found
        scene = _sapien(here)
        if scene is not None:
            return "sapien", scene
        if "pybullet" in sys.modules:
            client = _pybullet(here)
            if client is not None:
                return "pybullet", client
    raise RecordError(
        f"no simulation in {type(env).__name__}: looked for MuJoCo's model and data, SAPIEN's scene "
        f"and PyBullet's client, in it and inside {', '.join(_INSIDE)}. Record it yourself: "
        "safestage_record.mujoco(model, data, path), .sapien(scene, path) or .pybullet(client, path)."
    )


def _inside(env: Any) -> list[Any]:
    """The environment and what it holds, from the outside in."""
    todo: list[Any] = [env]
    seen: list[Any] = []
    while todo:
        here = todo.pop(0)
        if any(here is other for other in seen):
            continue
        seen.append(here)
        held = (getattr(here, name, None) for name in _INSIDE)
        todo += [some for some in held if some is not None and not callable(some)]
    return seen


def _mujoco(here: Any) -> tuple[Any, Any] | None:
    import mujoco

    model = _plain(getattr(here, "model", None), mujoco.MjModel)
    data = _plain(getattr(here, "data", None), mujoco.MjData)
    return None if model is None or data is None else (model, data)


def _plain(holder: Any, kind: Any) -> Any:
    """An object of MuJoCo's, or the one that robosuite's and dm_control's classes hold; None if neither."""
    inside = (getattr(holder, name, None) for name in ("_model", "_data", "ptr"))
    return next((some for some in (holder, *inside) if isinstance(some, kind)), None)


def _sapien(here: Any) -> Any:
    """SAPIEN's scene, of ManiSkill's the only one."""
    scene = getattr(here, "scene", None)
    scenes = getattr(scene, "sub_scenes", None)
    if isinstance(scenes, list):
        if len(scenes) != 1:
            raise RecordError(
                f"ManiSkill simulates {len(scenes)} scenes at once. Allowed: num_envs=1, on the CPU."
            )
        return scenes[0]
    return scene if hasattr(scene, "physx_system") else None


def _pybullet(here: Any) -> int | None:
    pybullet = sys.modules["pybullet"]
    for name in _CLIENTS:
        client = getattr(here, name, None)
        client = getattr(client, "_client", client)
        whole = isinstance(client, int) and not isinstance(client, bool) and client >= 0
        if whole and pybullet.isConnected(client):
            return int(client or 0)
    return None
