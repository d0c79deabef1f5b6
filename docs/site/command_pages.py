"""The page of all commands, read from the command line itself."""

from __future__ import annotations

import re
from collections.abc import Iterator

import click

from safestage_eval.cli import group

HEAD = """\
# Every command and option

Written from the commands themselves: what `safestage COMMAND --help` prints. [The command line](../cli.md) says
what all of them have in common.

Every command also takes `--limits`, which lets it read larger episodes ([limits](../security.md#limits)).
"""


def commands_page() -> str:
    """All commands, subcommands included, with their options."""
    context = click.Context(group, info_name="safestage")
    parts = [HEAD]
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if command is None:
            raise LookupError(
                f"safestage {name} cannot be loaded: is the extra simulate installed?"
            )
        parts.extend(_sections(command, click.Context(command, context, name), 2))
    return "\n".join(parts)


def plain(text: str) -> str:
    """Text in which Markdown finds nothing to lay out."""
    return re.sub(r"([\\`*_<>\[\]|])", r"\\\1", text)


def _sections(command: click.Command, context: click.Context, level: int) -> Iterator[str]:
    yield f"{'#' * level} {context.command_path}\n"
    if not isinstance(command, click.Group):
        usage = " ".join(command.collect_usage_pieces(context))
        yield f"```\n{context.command_path} {usage}\n```\n"
    yield from _help(command.help or "")
    options = [row for row in _rows(command, context) if row is not None]
    if options:
        yield "| option | does |\n|---|---|"
        yield "\n".join(options) + "\n"
    if isinstance(command, click.Group):
        for name, one in command.commands.items():
            yield from _sections(one, click.Context(one, context, name), level + 1)


def _help(text: str) -> Iterator[str]:
    """Paragraphs; those that click leaves as they are become code."""
    for paragraph in text.split("\n\n"):
        if not paragraph.lstrip().startswith("\b"):
            yield plain(" ".join(paragraph.split())) + "\n"
            continue
        lines = paragraph.replace("\b", "").strip("\n").splitlines()
        if lines[0].rstrip().endswith(":"):
            yield f"{plain(lines.pop(0).strip())}\n"
        indent = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
        yield "\n".join(["```", *(line[indent:].rstrip() for line in lines), "```\n"])


def _rows(command: click.Command, context: click.Context) -> Iterator[str | None]:
    for parameter in command.params:
        if not isinstance(parameter, click.Option) or "--limits" in parameter.opts:
            continue
        record = parameter.get_help_record(context)
        if record is None:
            continue
        names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        takes = "" if parameter.is_flag else f" {plain(parameter.make_metavar(context))}"
        yield f"| {names}{takes} | {plain(' '.join(record[1].split()))} |"
