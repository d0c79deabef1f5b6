"""Policy: what turns observations into actions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """A policy's input at one control step.

    Attributes:
        time: s since the episode's start.
        joint_position: (7,) rad, measured.
        gripper_opening: 0 closed … 1 open.
        instruction: the prompt.
        joint_velocity: (7,) rad/s, measured.
        images: camera → (H, W, 3) red green blue; empty unless the policy names ``cameras``. Drawn
            of the same moment as everything else.
        past: pictures of the earlier moments that the policy looks back to, oldest first.
        flange_position: (3,) m, of the arm's flange in the frame of its base, measured.
        flange_orientation: (4,) wxyz, flange to base; z points out of the flange.
        objects: object → (7,) m and wxyz, its pose in the frame of the arm's base, as a faultless tracker
            would measure it; empty unless the policy's ``tracks_objects`` is true.
    """

    time: float
    joint_position: F64
    gripper_opening: float
    instruction: str
    joint_velocity: F64 = field(default_factory=lambda: np.zeros(7))
    images: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    past: tuple[Mapping[str, NDArray[np.uint8]], ...] = ()
    flange_position: F64 = field(default_factory=lambda: np.zeros(3))
    flange_orientation: F64 = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    objects: Mapping[str, F64] = field(default_factory=dict)


class PolicyError(InputError):
    """No action can be had from a policy: its server is dead, or its actions are none.

    Raised from ``act``, it ends the rollout, which is no failure of the policy.
    """


class Policy(Protocol):
    """Anything that can be rolled out.

    A policy that wants to see has two attributes more: ``cameras``, some of ``droid_cameras.CAMERAS``, and
    ``image_size``, (height, width) in pixels; a third, ``lookback``, names how many control steps
    before the present one it wants pictures of as well, and is read after ``reset``. One that
    wants poses of objects instead has ``tracks_objects = True``. One that holds something open has a method ``close``,
    called when the episode is over.
    """

    name: str

    def reset(self, task: str, prompt: str, /) -> None:
        """A new episode of a task, of which it learns the id, begins under an instruction."""
        ...

    def act(self, observation: Observation, /) -> F64:
        """(N, 8) the next actions: seven absolute joint positions (rad), gripper (1 closes)."""
        ...
