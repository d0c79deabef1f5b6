"""Check that graded references become unsafe where the analytic value of their signal does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from safestage_eval.verdicts.verdict import Verdict
from simulate.tasks.grades import Grade
from simulate.tasks.task import Task

from .feasibility import Case, Trial, trials


@dataclass(frozen=True)
class GradeResult:
    """One grade on one seed.

    Attributes:
        task: its id.
        grade: its name.
        seed: of the environment.
        trials: in the order of the grade's values.
        limit: where the analytic value turns unsafe; None where nothing was violated.
        problems: what is not as it should be, in words.
    """

    task: str
    grade: str
    seed: int
    trials: tuple[Trial, ...]
    limit: float | None
    problems: tuple[str, ...]


def grade_cases(
    task: Task, name: str, seeds: Sequence[int], robot_mjcf: Path | None = None
) -> list[Case]:
    """Every value on every seed, seeds outermost."""
    return [
        Case(task, f"reference:{name}={value:g}", seed, robot_mjcf=robot_mjcf)
        for seed in seeds
        for value in task.grades[name].values
    ]


def grade_results(
    tasks: Sequence[Task], seeds: Sequence[int], *, jobs: int = 1, robot_mjcf: Path | None = None
) -> Iterator[GradeResult]:
    """Run and judge all grades of tasks, each on every seed."""
    grades = [(task, name, seed) for task in tasks for name in task.grades for seed in seeds]
    todo = [
        case for task, name, seed in grades for case in grade_cases(task, name, [seed], robot_mjcf)
    ]
    results = trials(todo, jobs=jobs)
    for task, name, seed in grades:
        grade = task.grades[name]
        yield grade_result(task.id, name, seed, grade, [next(results) for _ in grade.values])


def grade_result(
    task: str, name: str, seed: int, grade: Grade, tried: Sequence[Trial]
) -> GradeResult:
    """Hold recorded verdicts against the analytic value.

    Every value must reach the goal; the first must pass and the last violate, with one flip between.
    A value whose analytic signal is on the safe side of the limit, by more than the tolerance, must
    pass; one on the other side must violate the signal.
    """
    driven = [
        v for t in tried for v in t.verdicts if v.verdict == "violation" and _drives(grade, v)
    ]
    limit = grade.limit if grade.limit is not None else driven[0].limit if driven else None
    problems = []
    if limit is None:
        problems.append(f"no value violates by {grade.signal}")
    broken = []
    for value, trial in zip(grade.values, tried, strict=True):
        names = {v.verdict for v in trial.verdicts}
        if trial.success_time is None or not names or not names <= {"pass", "violation"}:
            why = trial.problem or "goal not reached, or a rule that does not apply or decide"
            problems.append(f"at {value:g} {grade.unit}: {why}")
        broken.append("violation" in names)
        if limit is None:
            continue
        expected = grade.at(value)
        if abs(expected - limit) <= grade.tolerance:
            continue
        unsafe = (expected > limit) != (grade.at(grade.values[0]) > limit)
        if unsafe != broken[-1]:
            problems.append(
                f"at {value:g} {grade.unit} {grade.signal} should be {expected:.4g}, "
                f"{'beyond' if unsafe else 'within'} the limit {limit:.4g}, "
                f"but the verdict is {'violation' if broken[-1] else 'pass'}"
            )
        elif unsafe and not any(
            v.verdict == "violation" and _drives(grade, v) for v in trial.verdicts
        ):
            by = ", ".join(
                f"{v.rule} {v.signal}" for v in trial.verdicts if v.verdict == "violation"
            )
            problems.append(f"at {value:g} {grade.unit} it is violated by {by}, not {grade.signal}")
    flips = sum(a != b for a, b in pairwise(broken))
    if broken and (broken[0] or not broken[-1] or flips != 1):
        problems.append(
            "the verdict should flip once, from pass to violation; it is "
            + " ".join("violation" if b else "pass" for b in broken)
        )
    return GradeResult(task, name, seed, tuple(tried), limit, tuple(problems))


def measured(grade: Grade, trial: Trial) -> float | None:
    """Value of the driven signal, where it was the decisive one."""
    return next((v.value for v in trial.verdicts if _drives(grade, v)), None)


def _drives(grade: Grade, verdict: Verdict) -> bool:
    signal = verdict.signal or ""
    return grade.signal in (signal, signal.partition("(")[0])
