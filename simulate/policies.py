"""Policies: what turns observations into actions. References also get the privileged door."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

from .privileged import PrivilegedState
from .skills import Skills
from .task import Step, Task

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """What a policy may know at one control step.

    Attributes:
        time: s since the episode's start.
        joint_position: (7,) rad, measured.
        gripper_opening: 0 closed … 1 open.
        instruction: the prompt.
    """

    time: float
    joint_position: F64
    gripper_opening: float
    instruction: str


class Policy(Protocol):
    """Anything that can be rolled out."""

    name: str

    def reset(self, task: Task, prompt: str, /) -> None:
        """A new episode of a task begins, under an instruction."""
        ...

    def act(self, observation: Observation, /) -> F64:
        """(N, 8) the next actions: seven absolute joint positions (rad), gripper (1 closes)."""
        ...


class Idle:
    """Holds still, with the gripper open."""

    name = "idle"

    def reset(self, _task: Task, _prompt: str) -> None:
        """Nothing to prepare."""
        self._hold: F64 | None = None

    def act(self, observation: Observation) -> F64:
        """The joint positions it first saw, for ever."""
        if self._hold is None:
            self._hold = observation.joint_position.copy()
        return np.append(self._hold, 0.0)[None]


class Reference:
    """Plays a task's reference behaviour, closed loop on the true state."""

    def __init__(self, kind: str) -> None:
        """``kind``: safe or unsafe."""
        self.name = f"reference:{kind}"
        self._kind = kind

    def reset(self, task: Task, _prompt: str) -> None:
        """Look up the task's steps; ``look`` must follow."""
        self._steps: tuple[Step, ...] = getattr(task.references, self._kind)
        self._actions: Iterator[F64] = iter(())

    def look(self, state: PrivilegedState) -> None:
        """Be handed the privileged door."""
        skills = Skills(state)

        def play() -> Iterator[F64]:
            for step in self._steps:
                yield from skills.run(step.skill, step.arguments)

        self._actions = play()
        self._last = np.append(state.arm_position, 0.0)

    def act(self, _observation: Observation) -> F64:
        """The next action of the reference; the last one again when it has ended."""
        self._last = next(self._actions, self._last)
        return self._last[None]


POLICIES = ("reference:safe", "reference:unsafe", "idle")


def policy_named(name: str) -> Policy:
    """A built-in policy by name. Raises InputError for what is none."""
    if name == "idle":
        return Idle()
    if name in POLICIES:
        return Reference(name.partition(":")[2])
    raise InputError(f"policy {name!r}", "no such policy.", ", ".join(POLICIES))
