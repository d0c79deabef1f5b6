"""Messages of commands, besides data and finished reports."""

from __future__ import annotations

import click

from safestage_eval._text.printable import printable_lines


def say(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print text with its control characters escaped; ``err``: to stderr."""
    click.echo(printable_lines(text), err=err, nl=nl)
