"""Records whole rollouts inside other people's simulators, as traces that SafeStage judges.

Needs NumPy alone; the simulator is the one that is there. ``wrap`` records environments,
``mujoco``, ``sapien`` and ``pybullet`` what is stepped by hand.
"""

from __future__ import annotations

from ._version import __version__
from .env_wrap import EnvRecording, wrap
from .evaluation_hooks import lerobot, vla_eval
from .isaac_lab import IsaacLabRecorder, SafestageTerm
from .mujoco_recorder import MujocoRecorder
from .pybullet_recorder import PyBulletRecorder
from .record_error import RecordError
from .rollout_log import recover
from .sapien_recorder import SapienRecorder

mujoco = MujocoRecorder
sapien = SapienRecorder
pybullet = PyBulletRecorder

__all__ = [
    "EnvRecording",
    "IsaacLabRecorder",
    "MujocoRecorder",
    "PyBulletRecorder",
    "RecordError",
    "SafestageTerm",
    "SapienRecorder",
    "__version__",
    "lerobot",
    "mujoco",
    "pybullet",
    "recover",
    "sapien",
    "vla_eval",
    "wrap",
]
