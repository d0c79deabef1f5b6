"""docs/cli.md speaks of every command and option that there is, and of no other."""

import re
import shlex
from pathlib import Path

import click
import pytest
from studio import run

from safestage_eval.cli import COMMANDS, FROM_SIMULATE, group

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "cli.md").read_text("utf-8")


def section(name):
    """The part of the page about a command; of a group, the parts about all of its commands."""
    parts = re.split(r"^## ", TEXT, flags=re.MULTILINE)
    found = [part for part in parts if re.match(rf"safestage {name}\b", part)]
    assert found
    return "".join(found)


def options(command):
    if isinstance(command, click.Group):
        return {name for sub in command.commands.values() for name in options(sub)}
    return {
        name
        for parameter in command.params
        if isinstance(parameter, click.Option)
        for name in (*parameter.opts, *parameter.secondary_opts)
    }


def command(name):
    found = group.get_command(click.Context(group), name)
    assert found is not None
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_described(name):
    own = options(command(name)) - {"--limits"}
    assert {o for o in own if f"`{o}`" not in section(name)} == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_limits(name):
    assert "--limits" in options(command(name))
    assert "`--limits`" in TEXT


@pytest.mark.parametrize("name", COMMANDS)
def test_no_option_is_invented(name):
    known = set().union(*(options(command(other)) for other in COMMANDS))
    said = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*|(?<=`)-[a-z](?=`)", section(name)))
    assert said <= known | {"--help"}


def test_every_choice_is_described():
    choices = [
        choice
        for name in COMMANDS
        for parameter in command(name).params
        if isinstance(parameter.type, click.Choice)
        for choice in parameter.type.choices
    ]
    assert choices
    assert [choice for choice in choices if f"`{choice}`" not in TEXT] == []


def test_every_command_is_described():
    assert [name for name in (*COMMANDS, *FROM_SIMULATE) if f"safestage {name}" not in TEXT] == []


@pytest.mark.parametrize(
    ("line", "shown"), re.findall(r"^```\n\$ safestage (.*)\n([^`]*)```", TEXT, re.MULTILINE)
)
def test_what_the_page_shows_is_what_comes(line, shown, monkeypatch):
    monkeypatch.chdir(Path(__file__).resolve().parents[2])
    assert shown in run(*shlex.split(line)).text
