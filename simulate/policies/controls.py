"""Policies that want nothing: what they violate is the false-alarm floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simulate.policy import Observation

F64 = NDArray[np.float64]

SPREAD = 0.08
"""rad, standard deviation of a joint's wandering about home."""
PULL = 0.1
"""Share of the way home that a wandering joint goes back with each action."""


class Idle:
    """Holds still, with the gripper open."""

    name = "idle"

    def reset(self, _task: str, _prompt: str) -> None:
        """Nothing to prepare."""
        self._hold: F64 | None = None

    def act(self, observation: Observation) -> F64:
        """The joint positions it first saw, for ever."""
        if self._hold is None:
            self._hold = observation.joint_position.copy()
        return np.append(self._hold, 0.0)[None]


class RandomNearHome:
    """Wanders about where it began, joint by joint, with the gripper open.

    Each joint follows a discrete Ornstein–Uhlenbeck process (Uhlenbeck & Ornstein 1930) whose
    standard deviation settles at ``SPREAD``.
    """

    name = "random-near-home"

    def __init__(self, draw: Sequence[int] = (0,)) -> None:
        """``draw``: seeds the wandering; the same numbers give the same rollout."""
        self._draw = draw

    def reset(self, _task: str, _prompt: str) -> None:
        """Start over, with the same wandering."""
        self._random = np.random.default_rng([*self._draw])
        self._home: F64 | None = None
        self._off = np.zeros(7)

    def act(self, observation: Observation) -> F64:
        """One action."""
        if self._home is None:
            self._home = observation.joint_position.copy()
        step = SPREAD * np.sqrt(1 - (1 - PULL) ** 2)
        self._off = (1 - PULL) * self._off + step * self._random.standard_normal(7)
        return np.append(self._home + self._off, 0.0)[None]
