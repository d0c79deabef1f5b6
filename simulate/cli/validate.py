"""``safestage tasks validate``."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import chosen_tasks, explains, jobs_option, progress, robot_option, seeds_option

if TYPE_CHECKING:
    from simulate.feasibility import Trial
    from simulate.task import Task


@click.command()
@click.argument("tasks", nargs=-1, metavar="[TASK]...")
@seeds_option("Environment seeds to try.")
@click.option("--grades", is_flag=True, help="Try the graded references instead.")
@click.option(
    "--pictures",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for a sheet of twelve pictures of every episode.",
)
@jobs_option
@robot_option
@explains
def validate(
    tasks: tuple[str, ...],
    seeds: tuple[int, ...],
    grades: bool,
    pictures: Path | None,
    jobs: int,
    robot_mjcf: Path | None,
) -> None:
    """Run both references of every task on every seed and judge them.

    A task counts only when, on every seed, its safe reference reaches the goal and passes, and its
    unsafe reference reaches the goal and violates the assigned rule. Graded references must turn
    unsafe where the analytic value of their signal crosses its limit. Exit 1 if one does not.
    """
    from simulate.feasibility import cases, trials

    chosen = chosen_tasks(tasks)
    if grades:
        _grades(chosen, seeds, jobs, robot_mjcf)
        return
    todo = cases(chosen, seeds, robot_mjcf=robot_mjcf)
    wrong, width = 0, max(len(task.id) for task in chosen)
    click.echo(f"{'task':<{width}}  seed  reference  goal     verdict")
    with progress(len(todo), "episode") as show:
        for trial in trials(todo, jobs=jobs, each=_draws(pictures), done=show):
            wrong += not trial.as_expected
            click.echo(_row(trial, width))
    click.echo(f"{len(todo) - wrong} of {len(todo)} as they should be")
    if wrong:
        sys.exit(1)


def _row(trial: Trial, width: int) -> str:
    decisive = trial.decisive
    if decisive is None:
        said = trial.problem or "no assigned rule was judged"
    else:
        said = f"{decisive.rule} {decisive.verdict}: {decisive.explanation}"
    goal = "-" if trial.success_time is None else f"{trial.success_time:.1f} s"
    mark = "" if trial.as_expected else "  <- not as it should be"
    return (
        f"{trial.task:<{width}}  {trial.seed:>4}  {trial.policy.rpartition(':')[2]:<9}  "
        f"{goal:>6}  {said}  [{trial.speed:.0f}x real time]{mark}"
    )


def _grades(chosen: list[Task], seeds: tuple[int, ...], jobs: int, robot_mjcf: Path | None) -> None:
    from simulate.grading import grade_results, measured

    by_id = {task.id: task for task in chosen}
    total, wrong = 0, 0
    for found in grade_results(chosen, seeds, jobs=jobs, robot_mjcf=robot_mjcf):
        total, wrong = total + 1, wrong + bool(found.problems)
        grade = by_id[found.task].grades[found.grade]
        limit = "?" if found.limit is None else f"{found.limit:.4g}"
        click.echo(f"{found.task}  {found.grade}  seed {found.seed}  {grade.signal}, limit {limit}")
        for value, trial in zip(grade.values, found.trials, strict=True):
            was = measured(grade, trial)
            violated = [v.rule for v in trial.verdicts if v.verdict == "violation"]
            click.echo(
                f"  {value:>8g} {grade.unit:<4} expected {grade.at(value):<9.4g} "
                f"measured {'-' if was is None else format(was, '.4g'):<9} "
                f"{', '.join(violated) + ' violated' if violated else 'pass'}"
            )
        for problem in found.problems:
            click.echo(f"  <- {problem}")
    click.echo(f"{total - wrong} of {total} grades as they should be")
    if wrong:
        sys.exit(1)


def _draws(folder: Path | None) -> Any:
    if folder is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    return partial(_draw, folder)


def _draw(folder: Path, episode: Any) -> None:
    from simulate.render import EpisodeRenderer, contact_sheet, write_png

    with EpisodeRenderer(episode, 480, 360) as renderer:
        shots = [renderer.frame(i * (len(episode) - 1) // 11) for i in range(12)]
    write_png(contact_sheet(shots), folder / f"{episode.header.episode_id}.png")
