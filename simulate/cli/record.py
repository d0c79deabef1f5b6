"""``safestage record``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import (
    PROMPTS,
    BadInput,
    chosen_tasks,
    explains,
    jobs_option,
    progress,
    robot_option,
    seeds_option,
)


@click.command()
@click.argument("tasks", nargs=-1, metavar="[TASK]...")
@click.option(
    "--policy",
    "policies",
    multiple=True,
    default=("reference:safe", "reference:unsafe"),
    show_default=True,
    help="reference:safe, reference:unsafe, noisy:SIGMA[:unsafe], idle, random-near-home or "
    "replay:PATH[#EPISODE]; repeatable.",
)
@seeds_option("Environment seeds: each is one fixed scene.")
@click.option(
    "--prompt",
    "prompts",
    multiple=True,
    type=click.Choice([*PROMPTS, "all"]),
    default=("default",),
    show_default=True,
    help="Instruction condition; repeatable.",
)
@click.option("--rollouts", type=click.IntRange(1), default=1, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("traces"),
    show_default=True,
    help="Folder that the episodes go to.",
)
@click.option(
    "--format",
    "format_",
    type=click.Choice(["parquet", "mcap"]),
    default="parquet",
    show_default=True,
    help="A Parquet dataset, or one MCAP file per episode.",
)
@click.option(
    "--horizon",
    "--duration",
    type=click.FloatRange(0, min_open=True),
    help="Seconds allowed for reaching the goal, instead of the task's own.",
)
@jobs_option
@robot_option
@explains
def record(
    tasks: tuple[str, ...],
    policies: tuple[str, ...],
    seeds: tuple[int, ...],
    prompts: tuple[str, ...],
    rollouts: int,
    out: Path,
    format_: Any,
    horizon: float | None,
    jobs: int,
    robot_mjcf: Path | None,
) -> None:
    """Record rollouts in MuJoCo, complete and at 120 Hz.

    TASK is the id of a task (see `safestage tasks list`) or a task file; all tasks without one.
    The robot is frozen when the goal is reached and recorded for five seconds more. Episodes that
    are in --out already are skipped, so an interrupted recording can simply be started again.

    \b
    Examples:
      safestage record --out traces                         every task, both references
      safestage record fsh_orange_on_plate --seeds 0-9 --out oranges
      safestage record --policy idle --duration 10 --out idle --format mcap
      safestage-score traces --rules fsh                    and then
    """
    from simulate.record import plan
    from simulate.record import record as run

    todo = plan(
        chosen_tasks(tasks),
        policies,
        seeds,
        PROMPTS if "all" in prompts else prompts,
        rollouts,
        horizon=horizon,
        robot_mjcf=robot_mjcf,
    )
    failed = 0
    with progress(len(todo), "episode") as show:
        for n, outcome in enumerate(run(todo, out, format_, jobs, show), 1):
            failed += bool(outcome.problem)
            click.echo(f"[{n}/{len(todo)}] {outcome.episode_id}: {outcome}")
    if failed:
        raise BadInput(f"{failed} of {len(todo)} rollouts could not be recorded")
