"""References with what makes them worth learning from: other starts, shaky joints, pushes to recover from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from simulate.learn.disturbance import disturbance_note
from simulate.policy import Observation
from simulate.skills import run_skill
from simulate.skills.arm_motion import Motion, ease
from simulate.tasks.task import Task
from simulate.world.privileged import PrivilegedState
from simulate.world.world import CONTROL_RATE

from .reference_policies import Reference

F64 = NDArray[np.float64]

START = 0.06
"""rad, standard deviation per joint of where the reference begins, about home."""
FARTHEST = 0.12
"""rad that a joint begins from home, at most."""
SHAKE = 0.004
"""rad, standard deviation of the noise on each joint command."""
PUSHES = 0.25
"""Pushes per second, on average, while none is under way."""
PUSH = 0.045
"""rad, standard deviation per joint of a push: about 3 cm at the gripper."""
HOLDING = 0.35
"""Share of a push that is left while the gripper is closed."""
RISE, RETURN = 6, 9
"""Control steps in which a push builds up, and in which the arm comes back from it."""


class Demonstration(Reference):
    """A reference that begins elsewhere, shakes, and is pushed off its way now and then.

    The noise is put into the demonstrator's commands, so that its corrections are recorded too (Laskey et
    al., "DART: Noise injection for robust imitation learning", CoRL 2017). While it is pushed, its own plan
    waits.
    """

    def __init__(self, kind: str, draw: Sequence[int] = (0,)) -> None:
        """``draw`` seeds start, shaking and pushes; the same numbers give the same rollout."""
        super().__init__(kind)
        self.name = f"demonstration:{kind}"
        self._draw = draw

    def reset(self, task: str, prompt: str) -> None:
        """Start over, with the same noise."""
        super().reset(task, prompt)
        self._random = np.random.default_rng([*self._draw])
        self._spans: list[tuple[int, int]] = []
        self._step = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """For the episode's header: the control steps that are not the reference's own."""
        return disturbance_note(self._spans)

    def look(self, task: Task, state: PrivilegedState) -> None:
        """Be handed what only references may know. Raises InputError for a missing grade."""
        steps = task.steps(self._kind)

        def play() -> Iterator[F64]:
            yield from self._elsewhere(state.arm_position)
            motion = Motion(state)
            for step in steps:
                for action in run_skill(motion, step.skill, step.arguments):
                    if self._random.random() < PUSHES / CONTROL_RATE:
                        yield from self._pushed(action)
                    yield action

        self._actions = play()
        self._last = np.append(state.arm_position, 0.0)

    def act(self, observation: Observation) -> F64:
        """The next action, with noise on the joints and none on the gripper."""
        noise = SHAKE * self._random.standard_normal(7)
        action = super().act(observation) + np.append(noise, 0.0)
        self._step += 1
        return np.asarray(action)

    def _elsewhere(self, home: F64) -> Iterator[F64]:
        off = np.clip(START * self._random.standard_normal(7), -FARTHEST, FARTHEST)
        first = self._step
        for share in [*ease(0.8), 1.0, 1.0, 1.0, 1.0]:
            yield np.append(home + share * off, 0.0)
        self._spans.append((first, self._step - 1))

    def _pushed(self, action: F64) -> Iterator[F64]:
        size = PUSH * (HOLDING if action[7] > 0.5 else 1.0)
        off = np.append(size * self._random.standard_normal(7), 0.0)
        first = self._step
        for share in ease(RISE / CONTROL_RATE):
            yield action + share * off
        self._spans.append((first, self._step - 1))
        for _ in range(RETURN):
            yield action
