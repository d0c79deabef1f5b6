"""Feasibility of a task: the safe reference succeeds and passes, the unsafe one succeeds and violates."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import inf
from pathlib import Path

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.rules import RuleSet
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts.goal import goal_margin
from safestage_eval.verdicts.judging import judge
from safestage_eval.verdicts.verdict import Verdict
from simulate.policies.policy_names import policy_named
from simulate.record.jobs import write_recording
from simulate.record.rollout import Setting, roll_out
from simulate.record.worker_pool import Died, run_many
from simulate.tasks.task import Task

REFERENCES = ("reference:safe", "reference:unsafe")
CONTROLS = ("idle", "random-near-home")
SHORT_CONTROL = 20.0
"""s, of a control on other than the first seed."""
RULES = ("ish", "ets", "fsh")
"""The built-in rule files that references are judged by."""


@dataclass(frozen=True)
class Case:
    """One rollout to be tried."""

    task: Task
    policy: str
    seed: int
    rollout: int = 0
    robot_mjcf: Path | None = None
    horizon: float | None = None
    """s; the task's own where None."""
    keep: Path | None = None
    """Folder that the episode is written to, as a recording is."""


@dataclass(frozen=True)
class Trial:
    """Outcome of a policy on one seed.

    Attributes:
        task: its id.
        seed: of the environment.
        policy: its name.
        success_time: s; None if the goal was not reached.
        verdicts: of the assigned rules; for controls those of all rules that do apply.
        speed: simulated over processor time, recording and live goal included.
        problem: why there is no episode, if so.
        stage: of the task; empty if it does not matter.
        rollout: number of the rollout.
        goal_room: share of its limit by which the goal's closest condition is met at the end; None where
            it is not, or only yes or no counts.
        taken: s of processor time, judging included.
        simulated: s of episode.
    """

    task: str
    seed: int
    policy: str
    success_time: float | None = None
    verdicts: tuple[Verdict, ...] = ()
    speed: float = 0.0
    problem: str = ""
    stage: str = ""
    rollout: int = 0
    goal_room: float | None = None
    taken: float = 0.0
    simulated: float = 0.0

    @property
    def as_expected(self) -> bool:
        """Success, and all assigned rules pass (safe) or one is violated at the stage (unsafe).

        A rule that does not apply or cannot be decided is never as expected: the scene is wrong.
        A control reaches no goal and violates nothing.
        """
        verdicts = [v.verdict for v in self.verdicts]
        if self.policy in CONTROLS:
            return not self.problem and self.success_time is None and "violation" not in verdicts
        if self.success_time is None or not verdicts or not {*verdicts} <= {"pass", "violation"}:
            return False
        if not self.policy.endswith(":unsafe"):
            return "violation" not in verdicts
        return any(v.verdict == "violation" and self.stage in ("", v.stage) for v in self.verdicts)

    @property
    def decisive(self) -> Verdict | None:
        """The violated rule, or else the one that passed with the least margin."""
        return min(
            self.verdicts,
            key=lambda v: (v.verdict != "violation", v.margin_normalised or 0.0),
            default=None,
        )

    @property
    def room(self) -> float | None:
        """Share of its limit by which the decisive rule passes or is violated; None of yes and no."""
        decisive = self.decisive
        if decisive is None or decisive.margin is None or decisive.dimension == "time":
            return None
        return None if decisive.margin_normalised is None else abs(decisive.margin_normalised)


def cases(
    tasks: Sequence[Task],
    seeds: Sequence[int],
    policies: Sequence[str] = REFERENCES,
    rollouts: int = 1,
    robot_mjcf: Path | None = None,
    horizon: float | None = None,
    keep: Path | None = None,
) -> list[Case]:
    """Every combination, tasks outermost. ``horizon`` (s) replaces the tasks' own."""
    return [
        Case(task, policy, seed, rollout, robot_mjcf, horizon, keep)
        for task in tasks
        for policy in policies
        for seed in seeds
        for rollout in range(rollouts)
    ]


def control_cases(
    tasks: Sequence[Task],
    seeds: Sequence[int],
    rollouts: int = 1,
    robot_mjcf: Path | None = None,
    horizon: float | None = None,
) -> list[Case]:
    """Idle and random-near-home: over the tasks' own horizon on the first seed, 20 s on the others.

    What rests for so long in one layout rests in those next to it; ``horizon`` (s) is for all seeds.
    """
    out: list[Case] = []
    for task in tasks:
        for seed in seeds:
            seconds = horizon or (None if seed == seeds[0] else SHORT_CONTROL)
            out += cases([task], [seed], CONTROLS, rollouts, robot_mjcf, seconds)
    return out


def trials(
    todo: Sequence[Case],
    *,
    jobs: int = 1,
    done: Callable[[int], None] | None = None,
) -> Iterator[Trial]:
    """Run and judge cases in memory; what comes back is in their order.

    Args:
        todo: see ``cases``.
        jobs: processes.
        done: called with the number done.
    """
    results = run_many(attempt, todo, jobs, done)
    for case, trial in zip(todo, results, strict=True):
        if isinstance(trial, Died):
            yield Trial(
                case.task.id, case.seed, case.policy, problem=trial.reason, rollout=case.rollout
            )
        else:
            yield trial


def attempt(case: Case) -> Trial:
    """Run and judge one case in memory."""
    start = time.process_time()
    task = case.task
    setting = Setting(
        task,
        case.seed,
        rollout=case.rollout,
        horizon=case.horizon,
        robot_mjcf=case.robot_mjcf,
    )
    control = case.policy in CONTROLS
    try:
        writer = roll_out(setting, policy_named(case.policy, setting.draw))
    except InputError as error:
        return Trial(task.id, case.seed, case.policy, problem=str(error), rollout=case.rollout)
    episode = writer.episode()
    speed = float(episode.t[-1]) / (time.process_time() - start)
    if case.keep is not None:
        write_recording(writer, task, case.keep)
    verdicts = judge(episode, builtin_rules(), assigned_only=not control).verdicts
    return Trial(
        task.id,
        case.seed,
        case.policy,
        writer.header.success_time,
        tuple(v for v in verdicts if v.assigned or (control and v.verdict != "not_applicable")),
        speed,
        stage=task.stage,
        rollout=case.rollout,
        goal_room=_met_by(episode),
        taken=time.process_time() - start,
        simulated=float(episode.t[-1]),
    )


def _met_by(episode: Episode) -> float | None:
    margin = goal_margin(episode)
    return margin if margin is not None and 0 <= margin < inf else None


@cache
def builtin_rules() -> RuleSet:
    """Built-in rules of the three stages."""
    return load_rules(RULES)
