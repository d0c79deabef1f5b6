"""``safestage bench tasks validate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from safestage_eval.cli.outputs import Output
from safestage_eval.cli.terminal import say
from safestage_eval.formats.atomic import write_output

from .simulate_options import (
    BadInput,
    chosen_tasks,
    explains,
    jobs_option,
    progress,
    robot_option,
    seeds_option,
    share_option,
)

if TYPE_CHECKING:
    from simulate.feasibility.feasibility import Case, Trial
    from simulate.tasks.task import Task


@click.command()
@click.argument("tasks", nargs=-1, metavar="[TASK]...")
@seeds_option("Environment seeds to try.")
@share_option
@click.option("--grades", is_flag=True, help="Try the graded references instead.")
@click.option(
    "--noisy",
    type=click.FloatRange(0, min_open=True),
    metavar="SIGMA",
    help="Roll out both references with noise of SIGMA rad on the joint commands instead.",
)
@click.option(
    "--controls", is_flag=True, help="Try idle and random-near-home instead, by all rules."
)
@click.option(
    "--rollouts",
    type=click.IntRange(1),
    help="Rollouts per task and seed. Default: 5 with --noisy, otherwise 1.",
)
@click.option(
    "--horizon",
    type=click.FloatRange(0, min_open=True),
    help="Seconds allowed, instead of the task's own; of controls, instead of 20 on other seeds than the "
    "first.",
)
@click.option(
    "--write",
    "table",
    type=Output("markdown"),
    help="Write the table to this Markdown file; not with --grades.",
)
@click.option(
    "--keep",
    type=Output(file=False, folder=True),
    help="Also write the references' episodes to this folder, as `safestage bench record` does.",
)
@jobs_option
@robot_option
@explains
def validate(
    tasks: tuple[str, ...],
    seeds: tuple[int, ...],
    share: tuple[int, int] | None,
    grades: bool,
    noisy: float | None,
    controls: bool,
    rollouts: int | None,
    horizon: float | None,
    table: Path | None,
    keep: Path | None,
    jobs: int,
    robot_mjcf: Path | None,
) -> None:
    """Run both references of every task on every seed and judge them.

    A task counts only when, on every seed, its safe reference reaches the goal and passes, and its
    unsafe reference reaches the goal and violates an assigned rule. Exit 1 if one does not.

    \b
    --grades    every graded reference must turn unsafe where the analytic value of its signal
                crosses the limit
    --noisy     at least 95 % of noisy references must keep their verdict; tasks that keep fewer are
                listed
    --controls  idle must violate no rule at all; what random-near-home violates is listed
    """
    from simulate.feasibility.feasibility import REFERENCES, cases, control_cases

    if grades + controls + (noisy is not None) > 1:
        raise click.UsageError("--grades, --noisy and --controls are separate runs")
    if table is not None and grades:
        raise click.UsageError("--grades writes no table")
    if keep is not None and (grades or controls or noisy is not None):
        raise click.UsageError("--keep is for the references alone")
    chosen = chosen_tasks(tasks)
    if share is not None:
        chosen = chosen[share[0] - 1 :: share[1]]
        say(f"share {share[0]}/{share[1]}: {len(chosen)} tasks")
    if not chosen:
        raise BadInput("this share holds no task")
    if grades:
        _grades(chosen, seeds, jobs, robot_mjcf)
        return
    if controls:
        todo = control_cases(chosen, seeds, rollouts or 1, robot_mjcf, horizon)
    elif noisy is not None:
        policies = (f"noisy:{noisy:g}", f"noisy:{noisy:g}:unsafe")
        todo = cases(chosen, seeds, policies, rollouts or 5, robot_mjcf, horizon)
    else:
        todo = cases(chosen, seeds, REFERENCES, rollouts or 1, robot_mjcf, horizon, keep)
    results = _run(todo, jobs)
    good = sum(trial.as_expected for trial in results)
    say(f"{good} of {len(results)} as they should be")
    if table is not None:
        write_output(table, _page(results, controls, noisy).encode())
    if noisy is not None:
        sys.exit(_noise(results))
    if controls:
        sys.exit(any(not trial.as_expected for trial in results if trial.policy == "idle"))
    sys.exit(good < len(results))


def _page(results: list[Trial], controls: bool, noisy: float | None) -> str:
    from simulate.feasibility.feasibility_table import controls_page, noise_page, page

    if controls:
        return controls_page(results)
    return page(results) if noisy is None else noise_page(results, noisy)


def _run(todo: list[Case], jobs: int) -> list[Trial]:
    from simulate.feasibility.feasibility import trials

    width = max(len(case.task.id) for case in todo)
    kinds = max(len(case.policy.removeprefix("reference:")) for case in todo)
    say(f"{'task':<{width}}  seed  {'policy':<{kinds}}    goal  verdict")
    result = []
    with progress(len(todo), "episode") as show:
        for trial in trials(todo, jobs=jobs, done=show):
            result.append(trial)
            say(_row(trial, width, kinds))
    return result


def _row(trial: Trial, width: int, kinds: int) -> str:
    from simulate.feasibility.feasibility_table import said

    goal = "-" if trial.success_time is None else f"{trial.success_time:.1f} s"
    mark = "" if trial.as_expected else "  <- not as it should be"
    return (
        f"{trial.task:<{width}}  {trial.seed:>4}  "
        f"{trial.policy.removeprefix('reference:'):<{kinds}}  "
        f"{goal:>6}  {said(trial)}  [{trial.speed:.0f}x real time]{mark}"
    )


def _noise(results: list[Trial]) -> int:
    from simulate.feasibility.feasibility_table import SHARE_KEPT, kept

    share, weak = kept(results)
    say(f"{share:.1%} kept their verdict; at least {SHARE_KEPT:.0%} should")
    for line in weak:
        say(f"  {line}")
    return int(share < SHARE_KEPT)


def _grades(chosen: list[Task], seeds: tuple[int, ...], jobs: int, robot_mjcf: Path | None) -> None:
    from simulate.feasibility.grading import grade_results, measured

    by_id = {task.id: task for task in chosen}
    total, wrong = 0, 0
    for result in grade_results(chosen, seeds, jobs=jobs, robot_mjcf=robot_mjcf):
        total, wrong = total + 1, wrong + bool(result.problems)
        grade = by_id[result.task].grades[result.grade]
        limit = "?" if result.limit is None else f"{result.limit:.4g}"
        say(f"{result.task}  {result.grade}  seed {result.seed}  {grade.signal}, limit {limit}")
        for value, trial in zip(grade.values, result.trials, strict=True):
            was = measured(grade, trial)
            violated = [v.rule for v in trial.verdicts if v.verdict == "violation"]
            say(
                f"  {value:>8g} {grade.unit:<4} expected {grade.at(value):<9.4g} "
                f"measured {'-' if was is None else format(was, '.4g'):<9} "
                f"{', '.join(violated) + ' violated' if violated else 'pass'}"
            )
        for problem in result.problems:
            say(f"  <- {problem}")
    say(f"{total - wrong} of {total} grades as they should be")
    if wrong:
        sys.exit(1)
