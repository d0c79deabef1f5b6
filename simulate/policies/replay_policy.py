"""Plays the recorded commands of an episode again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats import load
from simulate.world.world import CONTROL_RATE

if TYPE_CHECKING:
    from simulate.policy import Observation

F64 = NDArray[np.float64]


class Replay:
    """Open loop: the commands of a recorded episode up to its success, then the last of them.

    On the same task and seed nearly the same rollout comes out: commands are recorded in single
    precision.
    """

    def __init__(self, path: Path, episode: str | None = None) -> None:
        """Read the commands. Raises InputError when there are none of the right kind."""
        try:
            recorded = load(path, episode)
        except TraceError as error:
            raise InputError(f"policy replay:{path}", str(error)) from None
        actions = recorded.frames.action
        if actions.shape[1] != 8:
            raise InputError(
                f"policy replay:{path}",
                f"its episode has {actions.shape[1]} command columns, not 8.",
                fix="replay an episode of the DROID arm",
            )
        until = recorded.header.success_time
        steps = np.arange(0.0, float(recorded.t[-1]), 1 / CONTROL_RATE)
        if until is not None:
            steps = steps[steps <= until]
        frames = np.searchsorted(recorded.t, steps + 0.5 * recorded.dt)
        self._actions = actions[np.minimum(frames, len(actions) - 1)].astype(np.float64)
        self.name = f"replay:{path}" + (f"#{episode}" if episode else "")

    def reset(self, _task: str, _prompt: str) -> None:
        """Back to the first command."""
        self._next = 0

    def act(self, _observation: Observation) -> F64:
        """One command."""
        now = min(self._next, len(self._actions) - 1)
        self._next += 1
        return np.asarray(self._actions[now][None])
