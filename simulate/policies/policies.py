"""Policies: what turns observations into actions. References also get the privileged door."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from simulate.clients.address import address_of, is_address
from simulate.skills import run_skill
from simulate.skills.arm_motion import Motion
from simulate.tasks.task import Task
from simulate.world.privileged import PrivilegedState

from .controls import Idle, RandomNearHome
from .import_path import class_at, imported
from .replay import Replay

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """What a policy may know at one control step.

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


class PolicyError(InputError):
    """No action can be had from a policy: its server is dead, or its actions are none.

    Raised from ``act``, it ends the rollout, which is no failure of the policy.
    """


class Policy(Protocol):
    """Anything that can be rolled out.

    A policy that wants to see has two attributes more: ``cameras``, some of ``cameras.CAMERAS``, and
    ``image_size``, (height, width) in pixels; a third, ``lookback``, names how many control steps
    before the present one it wants pictures of as well, and is read after ``reset``. One that holds something open has a method ``close``,
    called when the episode is over.
    """

    name: str

    def reset(self, task: str, prompt: str, /) -> None:
        """A new episode of a task, of which it learns the id, begins under an instruction."""
        ...

    def act(self, observation: Observation, /) -> F64:
        """(N, 8) the next actions: seven absolute joint positions (rad), gripper (1 closes)."""
        ...


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


POLICIES = (
    "reference:safe",
    "reference:unsafe",
    "reference:GRADE=VALUE",
    "noisy:SIGMA[:safe|:unsafe]",
    "idle",
    "random-near-home",
    "replay:PATH[#EPISODE]",
    "PROTOCOL:URL[?OPTION=VALUE&…]",
    "MODULE:CLASS",
)
"""What ``policy_named`` understands. SIGMA is in rad, EPISODE an id where PATH holds several;
PROTOCOL is one of ``clients.address.PROTOCOLS``, as in ``openpi:ws://127.0.0.1:8000?name=pi05``."""


def policy_named(name: str, draw: Sequence[int] = (0,)) -> Policy:
    """A policy by name, or by import path.

    Args:
        name: one of ``POLICIES``.
        draw: seeds what is random in it; the same numbers give the same rollout.

    Raises InputError for what is none.
    """
    if is_address(name):
        address = address_of(name)
        from simulate.clients.remote import Remote

        return Remote(address, seed=draw[1] if len(draw) > 1 else None)
    kind, _, rest = name.partition(":")
    if kind == "reference" and _is_reference(rest):
        return Reference(rest)
    if kind == "noisy":
        sigma, _, reference = rest.partition(":")
        if _is_number(sigma) and float(sigma) >= 0 and _is_reference(reference or "safe"):
            return Noisy(reference or "safe", float(sigma), draw)
    if kind == "replay" and rest:
        path, _, episode = rest.partition("#")
        return Replay(Path(path), episode or None)
    if kind not in ("reference", "noisy", "replay") and rest.isidentifier():
        return imported(name)
    if name == "idle":
        return Idle()
    if name == "random-near-home":
        return RandomNearHome(draw)
    raise InputError(f"policy {name!r}", "no such policy.", ", ".join(POLICIES))


@cache
def policy_name(name: str) -> str:
    """What the episodes of a policy are called by; one of a user's is not made for that."""
    if is_address(name):
        return address_of(name).name
    kind, _, rest = name.partition(":")
    if kind not in ("reference", "noisy", "replay") and rest.isidentifier():
        return str(class_at(name).name)
    return policy_named(name).name


def _is_reference(kind: str) -> bool:
    grade, _, value = kind.partition("=")
    return kind in KINDS or (bool(grade) and _is_number(value))


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
