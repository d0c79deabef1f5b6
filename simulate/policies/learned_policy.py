"""A network trained from demonstrations, acting on the arm, the prompt and the poses of objects."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from simulate.arm.kinematics import ArmAlone
from simulate.learn.checkpoint import opened
from simulate.learn.policy_inputs import arm_rows, object_rows, rotation_of
from simulate.learn.prompt_embedding import embedded
from simulate.learn.scene_slots import filled, slot_order
from simulate.policy import Observation
from simulate.tasks.task import tasks

F64 = NDArray[np.float64]


@cache
def _arm() -> ArmAlone:
    return ArmAlone()


class Learned:
    """A trained checkpoint as a policy.

    Its noise is drawn once an episode, so that it stays with the way it took.
    """

    tracks_objects = True

    def __init__(self, name: str, draw: Sequence[int] = (0,)) -> None:
        """Load a checkpoint, shipped or by path; ``draw`` seeds its noise. Raises InputError."""
        self.name = f"learned:{name}"
        self._checkpoint, self._draw = opened(name), draw

    def reset(self, task: str, prompt: str) -> None:
        """A new episode. Raises InputError for a task that is none of the benchmark's."""
        if task not in tasks():
            raise InputError(
                f"policy {self.name!r}", f"was not trained on the task {task!r}.",
                fix="see `safestage bench tasks list`",
            )  # fmt: skip
        self._roles, self._prompt = tasks()[task].roles, embedded(prompt)[None]
        width = max(self._checkpoint.noise, 1)
        random = np.random.default_rng([*self._draw])
        self._noise = random.standard_normal((1, width)).astype(np.float32)
        self._start: NDArray[Any] | None = None

    def act(self, observation: Observation) -> F64:
        """The actions to be played before the next look."""
        order = slot_order(observation.objects, self._roles)
        objects = object_rows(filled(observation.objects, order)[None])
        if self._start is None:
            self._start, self._command = objects[:, :, :3], observation.joint_position
        opening = np.array([observation.gripper_opening])
        answer = self._checkpoint.answer(
            arm=arm_rows(_arm(), observation.joint_position[None], opening),
            prompt=self._prompt, noise=self._noise, objects=objects, start=self._start,
            clock=np.array([[observation.time]], np.float32),
        )  # fmt: skip
        actions, command = [], self._command
        for row in answer[: self._checkpoint.play]:
            command, _ = _arm().joints(row[:3], rotation_of(row[3:9]), command)
            actions.append(np.append(command, float(row[9] > 0)))
        self._command = command
        return np.array(actions, np.float32).astype(np.float64)  # as protocols send them
