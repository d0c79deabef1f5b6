"""Records whole rollouts inside other people's simulators, as traces that SafeStage judges.

Needs NumPy alone; the simulator is the one that is there. ``mujoco`` records any model and data of
the MuJoCo bindings, ``wrap`` an environment that holds them.
"""

from __future__ import annotations

from ._version import __version__
from .env_wrap import EnvRecording, wrap
from .mujoco_recorder import MujocoRecorder
from .record_error import RecordError
from .rollout_log import recover

mujoco = MujocoRecorder

__all__ = [
    "EnvRecording",
    "MujocoRecorder",
    "RecordError",
    "__version__",
    "mujoco",
    "recover",
    "wrap",
]
