"""One stored episode of a MuJoCo simulator, whatever file it was in, and what its text fields say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json


@dataclass(frozen=True)
class Stored:
    """The stored data of one episode.

    Attributes:
        where: as messages say it.
        model: MJCF text; None where the file has none.
        states: (T, 1 + nq + nv) time, qpos, qvel; None where the file has none.
        actions: (T, A); A may be 0.
        ctrl: (T, nu) of the actuators, in force from each row on; nu may be 0.
        rewards: (T,) after each row's action, if any.
        meta: of the episode (``ep_meta``).
        about: of the file: ``env_args``, ``env_info``, ``problem_info`` and the like.
        index: number of the episode.
        successful: whether it was a success, where the collector says so without its moment.
        clocked: its rows have a time.
    """

    where: str
    model: str | None
    states: NDArray[Any] | None
    actions: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 0)))
    ctrl: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 0)))
    rewards: NDArray[Any] | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    index: int | None = None
    successful: bool | None = None
    clocked: bool = True

    @property
    def libero(self) -> str | None:
        """``suite/task`` of a LIBERO episode: the name of its problem file; None of any other."""
        file = self.about.get("bddl_file_name") or self._args.get("bddl_file")
        if not isinstance(file, str) or not file.endswith(".bddl"):
            return None
        path = PurePosixPath(file.replace("\\", "/"))
        return f"{path.parent.name}/{path.stem}"

    @property
    def _args(self) -> Mapping[str, Any]:
        return table_in(self.about.get("env_args"))

    @property
    def _kwargs(self) -> Mapping[str, Any]:
        return table_in(self._args.get("env_kwargs")) or table_in(self.about.get("env_info"))

    @property
    def task(self) -> str | None:
        """LIBERO's problem, or the environment's name."""
        name = self.libero or self._args.get("env_name") or self.about.get("env")
        return str(name) if name else None

    @property
    def instruction(self) -> str | None:
        """The instruction, if the file has one."""
        said = self.meta.get("lang") or table_in(self.about.get("problem_info")).get(
            "language_instruction"
        )
        if isinstance(said, list):
            said = " ".join(map(str, said))
        return str(said) if said else None

    @property
    def simulator(self) -> tuple[str, str | None]:
        """Name and version."""
        version = self.about.get("repository_version") or self._args.get("env_version")
        name = "LIBERO (robosuite)" if self.libero else "robosuite"
        return name, None if version is None else str(version)

    @property
    def mujoco_version(self) -> str | None:
        """Version of MuJoCo that recorded it, where the file says so."""
        places = (self.meta, self.about, self._args, self._kwargs)
        said = next((p["mujoco_version"] for p in places if p.get("mujoco_version")), None)
        return None if said is None else str(said)

    @property
    def control_dt(self) -> float | None:
        """Time between actions in s."""
        rate = self._kwargs.get("control_freq")
        return 1.0 / float(rate) if isinstance(rate, int | float) and rate > 0 else None

    @property
    def rewards_tell_success(self) -> bool:
        """Whether a reward above 0 means that the state after the row's action is a success.

        Not in LIBERO, whose converter rewards every last row, and not with shaped rewards.
        """
        return (
            self.rewards is not None
            and self.libero is None
            and self._kwargs.get("reward_shaping") is False
        )


def table_in(value: Any) -> Mapping[str, Any]:
    """A mapping, or one in JSON; an empty one for anything else."""
    if isinstance(value, bytes | str):
        try:
            value = from_json(value, foreign=True)
        except ValueError:
            return {}
    return value if isinstance(value, Mapping) else {}
