"""Policies of a user, for tests: found by import path."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from simulate.policy import PolicyError


class Still:
    """Holds still, and keeps what it was handed."""

    name = "still"

    def __init__(self) -> None:
        self.handed: list[Any] = []

    def reset(self, task: Any, prompt: Any) -> None:
        self.handed = [task, prompt]

    def act(self, observation: Any) -> Any:
        self.handed.append(observation)
        return np.append(observation.joint_position, 0.0)[None]


class Seeing(Still):
    name = "seeing"
    cameras = ("external", "wrist")
    image_size = (48, 64)


class Deadly(Still):
    """Takes its process along in one of the tasks, and takes its time in others."""

    name = "deadly"

    def reset(self, task: Any, prompt: Any) -> None:
        super().reset(task, prompt)
        if task == "fsh_orange_on_plate":
            os._exit(1)
        time.sleep(float(os.environ.get("NAP", "0")))


class Raising(Still):
    name = "raising"

    def act(self, observation: Any) -> Any:
        raise KeyError("no weights")


class Served(Still):
    """Its server dies in the middle of rollouts for as long as there is a file."""

    name = "served"

    def act(self, observation: Any) -> Any:
        if len(self.handed) > 4 and Path(os.environ["DEAD"]).exists():
            raise PolicyError("ws://gpu", "the connection broke off.")
        return super().act(observation)


class Unnamed:
    def reset(self, task: Any, prompt: Any) -> None: ...
