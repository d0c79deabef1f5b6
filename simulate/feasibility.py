"""Whether a task counts: safe reference succeeds and passes, unsafe one succeeds and violates."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts.judge import judge
from safestage_eval.verdicts.verdict import Verdict

from .policies import policy_named
from .rollout import Setting, roll_out
from .task import Task

REFERENCES = ("safe", "unsafe")
RULES = ("ish", "ets", "fsh")
"""The built-in rule files that references are judged by."""


@dataclass(frozen=True)
class Trial:
    """One reference on one seed.

    Attributes:
        task: its id.
        seed: of the environment.
        reference: safe or unsafe.
        success_time: s; None if the goal was not reached.
        verdicts: of the assigned rules.
        speed: simulated over processor time, recording and live goal included.
        problem: why there is no episode, if so.
    """

    task: str
    seed: int
    reference: str
    success_time: float | None = None
    verdicts: tuple[Verdict, ...] = ()
    speed: float = 0.0
    problem: str = ""

    @property
    def as_expected(self) -> bool:
        """Success, and all assigned rules pass (safe) or one is violated (unsafe).

        A rule that does not apply or cannot be decided is never as expected: the scene is wrong.
        """
        found = [v.verdict for v in self.verdicts]
        if self.success_time is None or not found or not {*found} <= {"pass", "violation"}:
            return False
        return ("violation" in found) == (self.reference == "unsafe")

    @property
    def decisive(self) -> Verdict | None:
        """The violated rule, or else the one that passed with the least margin."""
        return min(
            self.verdicts,
            key=lambda v: (v.verdict != "violation", v.margin_normalised or 0.0),
            default=None,
        )


def trials(
    tasks: Sequence[Task],
    seeds: Sequence[int],
    *,
    robot_mjcf: Path | None = None,
    each: Callable[[Episode], None] | None = None,
) -> Iterator[Trial]:
    """Run and judge both references of every task on every seed, in memory.

    ``each`` is handed every episode (to draw it, say).
    """
    rules = load_rules(RULES)
    for task in tasks:
        for reference in REFERENCES:
            for seed in seeds:
                start = time.process_time()
                setting = Setting(task, seed, robot_mjcf=robot_mjcf)
                try:
                    writer = roll_out(setting, policy_named(f"reference:{reference}"))
                except InputError as error:
                    yield Trial(task.id, seed, reference, problem=str(error))
                    continue
                speed = writer.episode().t[-1] / (time.process_time() - start)
                episode = writer.episode()
                if each is not None:
                    each(episode)
                verdicts = tuple(v for v in judge(episode, rules).verdicts if v.assigned)
                yield Trial(
                    task.id, seed, reference, writer.header.success_time, verdicts, float(speed)
                )
