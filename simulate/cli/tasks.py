"""``safestage tasks list|show``."""

from __future__ import annotations

import click

from .options import PROMPTS, explains


@click.group()
def tasks() -> None:
    """The benchmark's tasks: scenes, prompts, roles, rules and their references."""


@tasks.command("list")
@explains
def list_() -> None:
    """List the tasks: id, stage, assigned rules, default prompt."""
    from simulate.task import tasks as all_tasks

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
@explains
def show(task: str) -> None:
    """Show one task: prompts, roles, goal, rules, objects and references."""
    from simulate.task import task_named

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
    for name, grade in found.grades.items():
        values = ", ".join(f"{value:g}" for value in grade.values)
        lines += ["", f"  graded reference {name}: {grade.parameter}"]
        lines += [f"    {values} {grade.unit}; {grade.signal} = {grade.expected}"]
    click.echo("\n".join(lines))
