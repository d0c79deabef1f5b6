"""Messages of commands, besides data and finished reports."""

from __future__ import annotations

import os
import shutil
import sys

import click

from safestage_eval._text.line_width import LINE_WIDTH, folded
from safestage_eval._text.printable import printable_lines


def line_width() -> int | None:
    """Characters per line of the terminal, or of the variable COLUMNS; None of a file or a pipe."""
    if not (sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdecimal()):
        return None
    return shutil.get_terminal_size().columns or None


def say(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print text with its control characters escaped, lines folded; ``err``: to stderr."""
    click.echo(folded(printable_lines(text), LINE_WIDTH.get()), err=err, nl=nl)
