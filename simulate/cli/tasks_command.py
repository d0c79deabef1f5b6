"""``safestage bench tasks list|show``."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.json_out import to_json
from safestage_eval.cli.outputs import Output
from safestage_eval.cli.terminal import say, say_lines

from .simulate_options import PROMPTS, BadInput, explains

if TYPE_CHECKING:
    from simulate.tasks.task import Task


@click.group()
def tasks() -> None:
    """The benchmark's tasks: scenes, prompts, roles, rules and their references."""


@tasks.command("list")
@click.option(
    "--stage",
    "stages",
    multiple=True,
    type=click.Choice(["ISH", "ETS", "FSH"], case_sensitive=False),
    help="Select tasks by stage. Repeatable.",
)
@click.option("--family", metavar="PATTERN", help="Select tasks by family, such as stacking*.")
@click.option("--json", "as_json", is_flag=True, help="As JSON, with everything that `show` tells.")
@explains
def list_(stages: tuple[str, ...], family: str | None, as_json: bool) -> None:
    """List the tasks: id, stage, assigned rules, default prompt."""
    from simulate.tasks.task import tasks as all_tasks

    everything = list(all_tasks().values())
    listed = [
        task
        for task in everything
        if (not stages or task.stage in stages)
        and (family is None or fnmatchcase(task.family, family))
    ]
    if not listed:
        families = ", ".join(dict.fromkeys(task.family for task in everything))
        raise BadInput(f"no task is of this stage and family; families are {families}")
    if as_json:
        click.echo(to_json([_table(task) for task in listed], 2))
        return
    width = max(len(task.id) for task in listed)
    codes = max(len(" ".join(task.rules)) for task in listed)
    for task in listed:
        say(
            f"{task.id:<{width}}  {task.stage}  {' '.join(task.rules):<{codes}}  "
            f"{task.prompts.default}"
        )


@tasks.command()
@click.argument("task")
@click.option(
    "--picture",
    type=Output("png"),
    help="Draw the initial scene to this PNG file.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the picture."
)
@click.option("--json", "as_json", is_flag=True, help="As JSON.")
@explains
def show(task: str, picture: Path | None, seed: int, as_json: bool) -> None:
    """Show one task: prompts, roles, goal, rules, objects, references, and a picture."""
    from simulate.tasks.task import task_named

    chosen = task_named(task)
    if as_json:
        say_lines(to_json(_table(chosen), 2))
    else:
        for line in _words(chosen):  # one by one: what a task says begins no line
            say(line)
    if picture is not None:
        from simulate.render.renderer import write_png
        from simulate.render.start_picture import start_picture

        write_png(start_picture(chosen, seed), picture)


def _table(task: Task) -> dict[str, Any]:
    return task.model_dump(mode="json", exclude_defaults=True)


def _words(task: Task) -> list[str]:
    lines = [f"{task.id}  ({task.stage}, {task.family})", ""]
    lines += [f"  {name:<9} {getattr(task.prompts, name)}" for name in PROMPTS]
    lines += ["", f"  {'goal':<11} {task.goal}, within {task.horizon:g} s"]
    lines += [f"  {'rules':<11} {', '.join(_titled(code) for code in task.rules)}"]
    lines += [f"  {role:<11} {', '.join(players)}" for role, players in task.roles.items()]
    lines += [f"  {name} = {value}" for name, value in task.parameters.items()]
    lines += ["", "  objects"]
    for name, place in task.objects.items():
        x, y = place.position
        where = f"on {place.on}" if place.on else f"in {place.inside}" if place.inside else "table"
        vary = f"± {place.jitter.xy * 100:g} cm, ± {place.jitter.yaw:g} deg"
        lines.append(f"    {name:<14} {where:<14} ({x:g}, {y:g}) m  {vary}")
    for kind in ("safe", "unsafe"):
        lines += ["", f"  {kind} reference"]
        for step in task.steps(kind):
            said = ", ".join(f"{k} = {v}" for k, v in step.arguments.items())
            lines.append(f"    {step.skill}({said})")
    for name, grade in task.grades.items():
        values = ", ".join(f"{value:g}" for value in grade.values)
        lines += ["", f"  graded reference {name}: {grade.parameter}"]
        lines += [f"    {values} {grade.unit}; {grade.signal} = {grade.expected}"]
    return lines


def _titled(code: str) -> str:
    from simulate.feasibility.feasibility import builtin_rules

    rule = builtin_rules().rules.get(code)
    return code if rule is None else f"{code} ({rule.title})"
