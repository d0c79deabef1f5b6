"""One episode of a served policy, known by its requests alone."""

from __future__ import annotations

from contextlib import ExitStack, closing

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from simulate.arm import droid
from simulate.cameras.droid_cameras import SIZE, Cameras
from simulate.policies.policy_names import BUILT_IN, policy_named
from simulate.policies.reference_policies import Reference
from simulate.policy import Observation, Policy
from simulate.record.rollout import PROMPTS, Setting, observe, start, tracks_objects
from simulate.tasks.task import Task, tasks
from simulate.world.privileged import PrivilegedState
from simulate.world.world import World

F64 = NDArray[np.float64]

ASTRAY = 1e-2
"""rad that a joint may differ from what was expected of it."""


class Shadow:
    """A policy that knows the true state, in a world of its own beside the client's.

    A request says little of the scene. But the simulation is deterministic: with the same task, seed
    and actions, a world of the server's own is where the client's is. The policy closes its loop on
    that one. The observed joints tell whether the two still agree.
    """

    def __init__(self, policy: str, seed: int, task: str | None, observation: Observation) -> None:
        """Begin the episode that the observation is the first of.

        Args:
            policy: as ``policy_named`` takes it.
            seed: the environment seed that the client rolls out.
            task: the client's; the one whose prompt the observation holds, where None.
            observation: the first.

        Raises InputError for a prompt that is none of a task's, or of several.
        """
        own, prompt = _setting_of(observation.instruction, task)
        setting = Setting(own, seed, prompt)
        self.about = f"{own.id}, {prompt} prompt, seed {seed}"
        self._policy: Policy = policy_named(policy, setting.draw)
        self._world: World = start(setting)
        self._policy.reset(own.id, observation.instruction)
        if isinstance(self._policy, Reference):
            self._policy.look(own, PrivilegedState(self._world))
        self._instruction, self._steps = observation.instruction, 0
        self._chunk: list[F64] = []

    def fits(self, observation: Observation) -> bool:
        """Whether an observation matches this world's state."""
        off = np.abs(observation.joint_position - self._world.arm_position).max()
        return observation.instruction == self._instruction and bool(off <= ASTRAY)

    def is_over(self, observation: Observation) -> bool:
        """Whether an observation begins another episode: another prompt, or the arm at home again."""
        if observation.instruction != self._instruction:
            return True
        home = np.abs(observation.joint_position - droid.HOME).max() <= ASTRAY
        return bool(home) and not self.fits(observation)

    def answer(self, observation: Observation, play: int, rows: int) -> F64:
        """The actions of the next ``play`` control steps, the last one again up to ``rows``."""
        if not self.fits(observation):
            off = np.abs(observation.joint_position - self._world.arm_position)
            raise ValueError(
                f"joint {int(off.argmax()) + 1} is {off.max():.3f} rad away from where {self.about} is "
                f"after {self._steps} actions: does the client play {play} of each answer, on this "
                "seed, and absolute positions at 15 Hz?"
            )
        out = [self._next() for _ in range(play)]
        return np.array([*out, *[out[-1]] * (rows - play)])

    def _next(self) -> F64:
        if not self._chunk:
            with (
                ExitStack() as drawing
            ):  # as any thread may be the next to answer, which OpenGL minds
                wanted, cameras = tuple(getattr(self._policy, "cameras", ())), None
                if wanted:
                    size = getattr(self._policy, "image_size", SIZE)
                    cameras = drawing.enter_context(closing(Cameras(self._world, wanted, size)))
                seen = observe(
                    self._world, self._steps / 15, self._instruction, cameras,
                    objects=tracks_objects(self._policy),
                )  # fmt: skip
            self._chunk = list(np.asarray(self._policy.act(seen), np.float64))
        action = np.asarray(self._chunk.pop(0), np.float32).astype(np.float64)  # as it is sent
        self._world.act(action)
        self._steps += 1
        return action


class Direct:
    """A user's own policy: is handed what the request holds, and its actions go out as they are."""

    def __init__(self, policy: str, observation: Observation) -> None:
        """Begin an episode; the task is not known, so its id is empty."""
        self.about = repr(observation.instruction)
        self._policy = policy_named(policy)
        self._policy.reset("", observation.instruction)

    def is_over(self, observation: Observation) -> bool:  # noqa: ARG002
        """Never: only a reset or another session begins a new one."""
        return False

    def answer(self, observation: Observation, play: int, rows: int) -> F64:  # noqa: ARG002
        """The policy's actions."""
        return np.asarray(self._policy.act(observation), np.float64)


def is_own(policy: str) -> bool:
    """Whether a policy is a user's own, by import path."""
    kind, _, rest = policy.partition(":")
    return rest.isidentifier() and kind not in BUILT_IN


def _setting_of(instruction: str, task: str | None) -> tuple[Task, str]:
    """The task and the prompt condition that an instruction is of."""
    settings = [
        (each, prompt)
        for each in tasks().values()
        for prompt in PROMPTS
        if getattr(each.prompts, prompt) == instruction and task in (None, each.id)
    ]
    if not settings:
        whose = f"of {task}" if task else "of a task's"
        raise InputError(
            f"prompt {instruction!r}", f"none {whose}.", fix="see safestage bench tasks show"
        )
    if len({each.id for each, _ in settings}) > 1:
        several = ", ".join(each.id for each, _ in settings)
        raise InputError(
            f"prompt {instruction!r}", "of several tasks.", several, "serve with --task"
        )
    return settings[0]
