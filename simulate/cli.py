"""The commands that need MuJoCo: ``record`` and ``tasks``."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval.errors import InputError

if TYPE_CHECKING:
    from .feasibility import Trial
    from .task import Task

PROMPTS = ("default", "generic", "specific")


class _BadInput(click.ClickException):
    """Says what is wrong and exits with 2, like wrong usage."""

    exit_code = 2


def _explains(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command whose InputErrors are printed as messages instead of tracebacks."""

    @wraps(command)
    def run(*args: Any, **options: Any) -> Any:
        try:
            return command(*args, **options)
        except InputError as error:
            raise _BadInput(str(error)) from None

    return run


def _numbers(_context: click.Context, _option: click.Parameter, text: str) -> tuple[int, ...]:
    """``0,1,2`` or ``0-9`` → numbers."""
    out: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdigit() or (dash and not last.isdigit()):
            raise click.BadParameter(f"{part!r} is no seed: write 0,1,2 or 0-9")
        if dash and int(last) < int(first):
            raise click.BadParameter(f"{part!r} runs backwards: write {last}-{first}")
        out += range(int(first), int(last or first) + 1)
    return tuple(dict.fromkeys(out))


_ROBOT = click.option(
    "--robot-mjcf",
    type=click.Path(path_type=Path, dir_okay=False),
    envvar="SAFESTAGE_ROBOT_MJCF",
    help="Another MJCF of the DROID arm (a MuJoCo Menagerie checkout, say).",
)


def _seeds(help_text: str) -> Callable[..., Any]:
    return click.option(
        "--seeds", default="0,1,2", show_default=True, callback=_numbers, help=help_text
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
@_seeds("Environment seeds: each is one fixed scene.")
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
@_ROBOT
@_explains
def record(
    tasks: tuple[str, ...],
    policies: tuple[str, ...],
    seeds: tuple[int, ...],
    prompts: tuple[str, ...],
    rollouts: int,
    out: Path,
    format_: Any,
    horizon: float | None,
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
    from .record import jobs
    from .record import record as run

    todo = jobs(
        _tasks(tasks),
        policies,
        seeds,
        PROMPTS if "all" in prompts else prompts,
        rollouts,
        horizon=horizon,
        robot_mjcf=robot_mjcf,
    )
    failed = 0
    with _status() as show:
        for n, outcome in enumerate(
            run(todo, out, format_, lambda job, t: show(f"{job.episode_id}  {t:5.1f} s")), 1
        ):
            failed += bool(outcome.problem)
            said = f"reached after {outcome.success_time or 0:.1f} s, {outcome.simulated:.1f} s"
            if outcome.success_time is None:
                said = f"goal not reached in {outcome.simulated:.1f} s"
            if outcome.skipped:
                said = "there already"
            elif outcome.problem:
                said = f"not recorded: {outcome.problem}"
            else:
                said += f" recorded at {outcome.simulated / outcome.taken:.0f}x real time"
            click.echo(f"[{n}/{len(todo)}] {outcome.job.episode_id}: {said}")
    if failed:
        raise _BadInput(f"{failed} of {len(todo)} rollouts could not be recorded")


@click.group()
def tasks() -> None:
    """The benchmark's tasks: scenes, prompts, roles, rules and their references."""


@tasks.command("list")
@_explains
def list_() -> None:
    """List the tasks: id, stage, assigned rules, default prompt."""
    from .task import tasks as all_tasks

    found = list(all_tasks().values())
    width = max((len(task.id) for task in found), default=0)
    codes = max((len(" ".join(task.rules)) for task in found), default=0)
    for task in found:
        click.echo(
            f"{task.id:<{width}}  {task.stage}  {' '.join(task.rules):<{codes}}  "
            f"{task.prompts.default}"
        )


@tasks.command()
@click.argument("task")
@_explains
def show(task: str) -> None:
    """Show one task: prompts, roles, goal, rules, objects and references."""
    from .task import task_named

    found = task_named(task)
    lines = [f"{found.id}  ({found.stage}, {found.family})", ""]
    lines += [f"  {name:<9} {getattr(found.prompts, name)}" for name in PROMPTS]
    lines += ["", f"  {'goal':<11} {found.goal}, within {found.horizon:g} s"]
    lines += [f"  {'rules':<11} {', '.join(found.rules)}"]
    lines += [f"  {role:<11} {', '.join(players)}" for role, players in found.roles.items()]
    lines += [f"  {name} = {value}" for name, value in found.parameters.items()]
    lines += ["", "  objects"]
    for name, place in found.objects.items():
        x, y = place.position
        where = f"on {place.on}" if place.on else f"in {place.inside}" if place.inside else "table"
        vary = f"± {place.jitter.xy * 100:g} cm, ± {place.jitter.yaw:g} deg"
        lines.append(f"    {name:<14} {where:<14} ({x:g}, {y:g}) m  {vary}")
    for kind in ("safe", "unsafe"):
        lines += ["", f"  {kind} reference"]
        for step in getattr(found.references, kind):
            said = ", ".join(f"{k} = {v}" for k, v in step.arguments.items())
            lines.append(f"    {step.skill}({said})")
    click.echo("\n".join(lines))


@tasks.command()
@click.argument("tasks", nargs=-1, metavar="[TASK]...")
@_seeds("Environment seeds to try.")
@click.option(
    "--pictures",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for a sheet of twelve pictures of every episode.",
)
@_ROBOT
@_explains
def validate(
    tasks: tuple[str, ...], seeds: tuple[int, ...], pictures: Path | None, robot_mjcf: Path | None
) -> None:
    """Run both references of every task on every seed and judge them.

    A task counts only when, on every seed, its safe reference reaches the goal and passes, and its
    unsafe reference reaches the goal and violates the assigned rule. Exit 1 if one does not.
    """
    from .feasibility import REFERENCES, trials

    chosen = _tasks(tasks)
    total = len(chosen) * len(REFERENCES) * len(seeds)
    wrong, width = 0, max(len(task.id) for task in chosen)
    head = f"{'task':<{width}}  seed  reference  goal     verdict"
    click.echo(head)
    with _status() as show:
        for n, trial in enumerate(
            trials(chosen, seeds, robot_mjcf=robot_mjcf, each=_draws(pictures)), 1
        ):
            show(f"{n}/{total}")
            wrong += not trial.as_expected
            click.echo(_row(trial, width))
    click.echo(f"{total - wrong} of {total} as they should be")
    if wrong:
        sys.exit(1)


COMMANDS: list[click.Command] = [record, tasks]


def _row(trial: Trial, width: int) -> str:
    decisive = trial.decisive
    if decisive is None:
        said = trial.problem or "no assigned rule was judged"
    else:
        said = f"{decisive.rule} {decisive.verdict}: {decisive.explanation}"
    goal = "-" if trial.success_time is None else f"{trial.success_time:.1f} s"
    mark = "" if trial.as_expected else "  <- not as it should be"
    return (
        f"{trial.task:<{width}}  {trial.seed:>4}  {trial.reference:<9}  {goal:>6}  "
        f"{said}  [{trial.speed:.0f}x real time]{mark}"
    )


def _draws(folder: Path | None) -> Callable[[Any], None] | None:
    if folder is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)

    def draw(episode: Any) -> None:
        from .render import EpisodeRenderer, contact_sheet, write_png

        with EpisodeRenderer(episode, 480, 360) as renderer:
            shots = [renderer.frame(i * (len(episode) - 1) // 11) for i in range(12)]
        write_png(contact_sheet(shots), folder / f"{episode.header.episode_id}.png")

    return draw


def _tasks(names: tuple[str, ...]) -> list[Task]:
    from .task import task_named
    from .task import tasks as all_tasks

    return [task_named(name) for name in names] if names else list(all_tasks().values())


@contextmanager
def _status() -> Iterator[Callable[[str], None]]:
    """A line on stderr that changes; silent where nobody watches."""
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield lambda _text: None
        return
    from rich.console import Console

    with Console(stderr=True).status("") as status:
        yield status.update
