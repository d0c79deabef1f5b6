"""Cost of a campaign before it is run: rollouts, hours, gigabytes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from simulate.tasks.task import Task
from simulate.world.world import CONTROL_RATE

from .jobs import Job
from .rollout import HOLD_TIME

SPEED = 10.0
"""s of episode that one processor simulates, records and writes in a second, without cameras. Four to
eleven were measured on a machine with much else to do."""
BYTES = 120e3
"""Bytes of Parquet per second of episode: 110,000 to 150,000 where the arm moves, 70,000 where it rests."""


@dataclass(frozen=True)
class Estimate:
    """Cost of rollouts if each runs to its horizon.

    Attributes:
        rollouts: how many.
        seconds: of episode, five of hold after each horizon included.
        actions: that policies are asked for.
        horizons: (shortest, longest) in s.
    """

    rollouts: int
    seconds: float
    actions: int
    horizons: tuple[float, float]

    @classmethod
    def of(cls, jobs: Iterable[Job]) -> Estimate:
        """Estimate for these jobs."""
        horizons = [job.setting.horizon or job.setting.task.horizon for job in jobs]
        return cls(
            len(horizons),
            sum(horizons) + len(horizons) * HOLD_TIME,
            round(sum(horizons) * CONTROL_RATE),
            (min(horizons, default=0.0), max(horizons, default=0.0)),
        )

    def lines(self, processes: int) -> list[str]:
        """In words, for so many processes."""
        low, high = self.horizons
        span = f"{low:g} s" if low == high else f"{low:g} to {high:g} s"
        hours = self.seconds / SPEED / 3600
        return [
            f"at most {_round(self.seconds / 3600)} h of episode: each of {self.rollouts:,} to its "
            f"horizon of {span}, and {HOLD_TIME:g} s more",
            f"at most {_round(hours)} h of processor to simulate and record it, at about {SPEED:g} "
            f"times real time without cameras: {_round(hours / processes)} h in {processes} "
            f"process{'es' * (processes > 1)}",
            f"at most {_round(self.seconds * BYTES / 1e9)} GB, at about {BYTES / 1e3:g} kB a second",
            f"at most {self.actions:,} actions, whose time is the policy's own: each 10 ms an action "
            f"takes are {_round(self.actions * 0.01 / 3600)} h more for a server that answers one at "
            "a time",
        ]


def share_of(jobs: Sequence[Job], part: int, parts: int) -> list[Job]:
    """Every ``parts``-th task of these jobs, from the ``part``-th on, with all its rollouts.

    The shares of all parts are all jobs, and none is in two.
    """
    ids = list(dict.fromkeys(job.setting.task.id for job in jobs))
    mine = set(ids[part - 1 :: parts])
    return [job for job in jobs if job.setting.task.id in mine]


def counted(jobs: Sequence[Job]) -> str:
    """``97 tasks, 4 policies, 3 prompts, 3 seeds, 10 rollouts each: 34,920 rollouts``."""
    tasks: dict[str, Task] = {job.setting.task.id: job.setting.task for job in jobs}
    numbers = [
        (len(tasks), "task"),
        (len({job.policy for job in jobs}), "policy"),
        (len({job.setting.prompt for job in jobs}), "prompt"),
        (len({job.setting.seed for job in jobs}), "seed"),
        (len({job.setting.rollout for job in jobs}), "rollout"),
    ]
    said = [f"{n} {word if n == 1 else _several(word)}" for n, word in numbers]
    return f"{', '.join(said)} each: {len(jobs):,} rollouts"


def _several(word: str) -> str:
    return "policies" if word == "policy" else f"{word}s"


def _round(value: float) -> str:
    return f"{value:,.0f}" if value >= 10 else f"{value:.2g}"
