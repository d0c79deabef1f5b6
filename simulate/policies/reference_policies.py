"""References of a task as policies: they alone see the true state of the world."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from simulate.policy import Observation
from simulate.skills import run_skill
from simulate.skills.arm_motion import Motion
from simulate.tasks.task import Task
from simulate.world.privileged import PrivilegedState

F64 = NDArray[np.float64]

KINDS = ("safe", "unsafe")
"""The references that every task has."""


class Reference:
    """Plays a task's reference behaviour, closed loop on the true state."""

    def __init__(self, kind: str) -> None:
        """``kind``: safe, unsafe, or NAME=VALUE of a grade."""
        self.name = f"reference:{kind}"
        self._kind = kind

    def reset(self, _task: str, _prompt: str) -> None:
        """``look`` must follow."""
        self._actions: Iterator[F64] = iter(())

    def look(self, task: Task, state: PrivilegedState) -> None:
        """Be handed what only references may know. Raises InputError for a missing grade."""
        motion, steps = Motion(state), task.steps(self._kind)

        def play() -> Iterator[F64]:
            for step in steps:
                yield from run_skill(motion, step.skill, step.arguments)

        self._actions = play()
        self._last = np.append(state.arm_position, 0.0)

    def act(self, _observation: Observation) -> F64:
        """The next action of the reference; the last one again when it has ended."""
        self._last = next(self._actions, self._last)
        return self._last[None]


class Noisy(Reference):
    """A reference whose joint commands are off by a little, each time anew."""

    def __init__(self, kind: str, sigma: float, draw: Sequence[int] = (0,)) -> None:
        """``sigma``: rad, standard deviation per joint; ``draw`` seeds the noise."""
        super().__init__(kind)
        self.name = f"noisy:{sigma:g}" + (f":{kind}" if kind != "safe" else "")
        self._sigma, self._draw = sigma, draw

    def reset(self, task: str, prompt: str) -> None:
        """Start over, with the same noise."""
        super().reset(task, prompt)
        self._random = np.random.default_rng([*self._draw])

    def act(self, observation: Observation) -> F64:
        """The reference's next action, with noise on the joints and none on the gripper."""
        noise = self._sigma * self._random.standard_normal(7)
        return np.asarray(super().act(observation) + np.append(noise, 0.0))
