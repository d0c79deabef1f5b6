"""The page of all commands has every option and choice; docs/cli.md has every command and invents nothing."""

import re
import shlex
import sys
from dataclasses import fields
from pathlib import Path

import click
import pytest
from studio import run

from safestage_eval.cli import COMMANDS, FROM_SIMULATE, group
from safestage_eval.size_limits import Limits

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "cli.md").read_text("utf-8")
SHOWN = TEXT + (ROOT / "docs" / "what_if.md").read_text("utf-8")


sys.path.insert(0, str(ROOT / "docs" / "site"))

from command_pages import commands_page  # noqa: E402

REFERENCE = commands_page()
SHARED = REFERENCE.split("\n## ")[1]


def section(name):
    """The part of the reference about a command, its subcommands included, and the options that many share."""
    parts = re.split(r"^## ", REFERENCE, flags=re.MULTILINE)
    (found,) = [part for part in parts if part.startswith(f"safestage {name}\n")]
    return found


def first_cells(text):
    """The option names of each row of the tables in a text."""
    return [
        re.findall(r"`(-[\w-]+)`", line) for line in re.findall(r"^\| (`-.*?) \| \S", text, re.M)
    ]


def described(name):
    """The options in rows of the command's own, and the shared ones that it says it takes."""
    taken = set(
        re.findall(r"`(--[\w-]+)`", "".join(re.findall(r"^Also takes .*", section(name), re.M)))
    )
    rows = first_cells(section(name)) + [row for row in first_cells(SHARED) if row[0] in taken]
    return {option for row in rows for option in row}


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
    assert described(name) == options(command(name)) - {"--limits"}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_limits(name):
    assert "--limits" in options(command(name))
    assert "`--limits`" in REFERENCE.split("\n## ")[0]


def test_no_option_is_invented():
    known = set().union(*(options(command(name)) for name in (*COMMANDS, *FROM_SIMULATE)))
    said = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*|(?<=`)-[a-z](?=`)", TEXT))
    assert said <= known | {"--help"}


def test_every_choice_is_described():
    for name in COMMANDS:
        for parameter in command(name).params:
            if isinstance(parameter.type, click.Choice):
                assert "\\|".join(parameter.type.choices) in section(name) + SHARED


def test_every_command_is_described():
    assert [name for name in (*COMMANDS, *FROM_SIMULATE) if f"`{name}`" not in TEXT] == []


@pytest.mark.parametrize(
    ("line", "shown"), re.findall(r"^```\n\$ safestage (.*)\n([^`]*)```", SHOWN, re.MULTILINE)
)
def test_what_the_page_shows_is_what_comes(line, shown, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert shown in run(*shlex.split(line)).text


def test_every_limit_is_described():
    rows = re.findall(r"^\| `(\w+)` \| [\d,]+ \| \S", REFERENCE.split("\n## Limits\n")[1], re.M)
    assert rows == [field.name for field in fields(Limits)]
