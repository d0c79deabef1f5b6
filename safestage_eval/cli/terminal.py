"""Messages of commands, besides data and finished reports."""

from __future__ import annotations

import os
import re
import shutil
import sys
from functools import partial
from typing import Any, Protocol

import click

from safestage_eval._text.line_width import LINE_WIDTH, folded
from safestage_eval._text.printable import printable, printable_lines


def line_width() -> int | None:
    """Characters per line of the terminal, or of the variable COLUMNS; None of a file or a pipe."""
    if not (sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdecimal()):
        return None
    return shutil.get_terminal_size().columns or None


class Bar(Protocol):
    """A progress bar on the terminal."""

    def start(self) -> None:
        """Show it."""

    def stop(self) -> None:
        """Hide it."""


BARS: list[Bar] = []
"""Bars on the terminal; messages hide them for a moment."""


def say(text: str, *, err: bool = False) -> None:
    """Print one line, folded, with its control characters and line breaks escaped; ``err``: to stderr.

    A name with a line break in it could otherwise say anything at the beginning of a line.
    """
    _print(printable(text), err=err)


def say_lines(text: str, *, err: bool = False, color: bool = False) -> None:
    """Print lines that were made of printable names; their other control characters are escaped.

    ``color``: errors, the words that they mean and what to do about them stand out.
    """
    shown = printable_lines(text)
    if color:
        for mark, look in _LOOKS.items():
            shown = re.sub(mark, partial(_styled, look), shown, flags=re.MULTILINE)
    _print(shown, err=err, nl=bool(text) and not text.endswith("\n"))


def _styled(look: dict[str, Any], found: re.Match[str]) -> str:
    return click.style(found[0], **look)


_LOOKS: dict[str, dict[str, Any]] = {
    r"^error\[\w+\](?=:)": {"fg": "red", "bold": True},
    r"(?<=\| )[ \t]*\^+$": {"fg": "red"},
    r"^ *= fix:": {"fg": "green"},
    r"^ *= allowed:": {"fg": "blue"},
    r"^ *-->": {"dim": True},
}
"""Parts of a diagnostic → how they look."""


def _print(text: str, *, err: bool, nl: bool = True) -> None:
    for bar in BARS:
        bar.stop()
    click.echo(folded(text, LINE_WIDTH.get()), err=err, nl=nl)
    for bar in BARS:
        bar.start()
