"""The page of all commands, read from the command line itself."""

from __future__ import annotations

import inspect
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields

import click

from safestage_eval.cli import HELP, group
from safestage_eval.size_limits import Limits

HEAD = """\
# Every command and option

Written from the commands themselves: what `safestage COMMAND --help` prints. [The command line](../cli.md) says
what all of them have in common. Every command also takes `--limits`, which lets it read [larger episodes](#limits).
"""

LIMITS = """\
## Limits

An episode that exceeds one of them is a listed problem: `--limits bodies=10000,decoded=1GB` or `--limits none` raises them, or
`SAFESTAGE_LIMITS` in the environment.

| limit | at most | |
|---|---|---|
"""

SHARED = "## Shared options\n"

MANY = 4
"""Commands. An option that so many of them share is described once, in a section of its own."""

Row = tuple[str, str]
"""An option's names with what it takes, and what it does."""


def commands_page() -> str:
    """All commands, subcommands included, with their options."""
    parents = click.Context(group, info_name="safestage")
    commands = [
        found
        for name in HELP
        for found in _tree(
            _command(name, parents), click.Context(_command(name, parents), parents, name), 2
        )
    ]
    counts = Counter(row for command, context, _ in commands for row in _rows(command, context))
    shared = {row for row, count in counts.items() if count >= MANY}
    parts = [HEAD, SHARED, *_table(row for row in counts if row in shared)]
    for command, context, level in commands:
        parts.extend(_section(command, context, level, shared))
    parts.append(LIMITS + "\n".join(_limits()) + "\n")
    return "\n".join(parts)


def plain(text: str) -> str:
    """Text in which Markdown finds nothing to lay out."""
    return re.sub(r"([\\`*_<>\[\]|])", r"\\\1", text)


def _command(name: str, context: click.Context) -> click.Command:
    command = group.get_command(context, name)
    if command is None:
        raise LookupError(f"safestage {name} cannot be loaded: is the extra simulate installed?")
    return command


def _tree(
    command: click.Command, context: click.Context, level: int
) -> Iterator[tuple[click.Command, click.Context, int]]:
    """A command and its subcommands, each with the level of its heading."""
    yield command, context, level
    if isinstance(command, click.Group):
        for name, one in command.commands.items():
            yield from _tree(one, click.Context(one, context, name), level + 1)


def _limits() -> Iterator[str]:
    """A row for each limit on an episode, as its declaration describes it."""
    text = inspect.getdoc(Limits) or ""
    for one in fields(Limits):
        said = re.search(rf"^    {one.name}: (.+)$", text, re.MULTILINE)
        if said is None:
            raise LookupError(f"docs/site/command_pages.py: nothing describes {one.name}")
        yield f"| `{one.name}` | {getattr(Limits(), one.name):,} | {said[1]} |"


def _section(
    command: click.Command, context: click.Context, level: int, shared: set[Row]
) -> Iterator[str]:
    yield f"{'#' * level} {context.command_path}\n"
    if not isinstance(command, click.Group):
        usage = " ".join(command.collect_usage_pieces(context))
        yield f"```\n{context.command_path} {usage}\n```\n"
    yield from _help(command.help or "")
    rows = list(_rows(command, context))
    yield from _table(row for row in rows if row not in shared)
    also = [names.split(",")[0].split(" ")[0] for names, does in rows if (names, does) in shared]
    if also:
        yield f"Also takes [{', '.join(also)}](#shared-options).\n"


def _help(text: str) -> Iterator[str]:
    """Paragraphs; those that click leaves as they are become code, below their heading."""
    for paragraph in text.split("\n\n"):
        if not paragraph.lstrip().startswith("\b"):
            yield plain(" ".join(paragraph.split())) + "\n"
            continue
        lines = [line for line in paragraph.replace("\b", "").splitlines() if line.strip()]
        if lines[0].rstrip().endswith(":"):
            yield f"{plain(lines.pop(0).strip())}\n"
        indent = min(len(line) - len(line.lstrip()) for line in lines)
        yield "\n".join(["```", *(line[indent:].rstrip() for line in lines), "```\n"])


def _table(rows: Iterator[Row]) -> Iterator[str]:
    lines = [f"| {names} | {does} |" for names, does in rows]
    if lines:
        yield "\n".join(["| option | does |", "|---|---|", *lines]) + "\n"


def _rows(command: click.Command, context: click.Context) -> Iterator[Row]:
    for parameter in command.params:
        if not isinstance(parameter, click.Option) or "--limits" in parameter.opts:
            continue
        record = parameter.get_help_record(context)
        if record is None:
            continue
        names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        takes = "" if parameter.is_flag else f" {plain(_takes(parameter, context))}"
        yield f"{names}{takes}", plain(" ".join(record[1].split()))


def _takes(option: click.Option, context: click.Context) -> str:
    """The placeholder of an option's value; a range of numbers is left to its help text."""
    return option.make_metavar(context).replace("INTEGER RANGE", "N").replace("FLOAT RANGE", "X")
