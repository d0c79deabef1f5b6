"""Messages and progress of commands, besides data and finished reports."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.line_width import LINE_WIDTH, folded
from safestage_eval._text.printable import printable, printable_lines

if TYPE_CHECKING:
    from rich.progress import Progress

    from safestage_eval._serving.guarded_http import GuardedServer


def line_width() -> int | None:
    """Characters per line of the terminal, or of the variable COLUMNS; None of a file or a pipe."""
    if not (sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdecimal()):
        return None
    return shutil.get_terminal_size().columns or None


BARS: list[Progress] = []
"""Bars on the terminal; messages hide them for a moment."""


def say(text: str, *, err: bool = False) -> None:
    """Print one line, folded, with its control characters and line breaks escaped; ``err``: to stderr.

    A name with a line break in it could otherwise say anything at the beginning of a line.
    """
    _print(printable(text), err=err)


def say_problems(problems: Iterable[object]) -> None:
    """Print each problem, or its message, as a line on stderr."""
    for problem in problems:
        say(f"problem: {getattr(problem, 'message', problem)}", err=True)


def say_lines(text: str, *, err: bool = False, color: bool = False) -> None:
    """Print lines that were made of printable names; their other control characters are escaped.

    ``color``: errors, the words that they mean and what to do about them stand out.
    """
    shown = printable_lines(text)
    for mark, look in _LOOKS.items() if color else ():
        shown = re.sub(mark, lambda found, look=look: click.style(found[0], **look), shown)  # type: ignore[misc]
    _print(shown, err=err, nl=bool(text) and not text.endswith("\n"))


_LOOKS: dict[str, dict[str, Any]] = {
    r"(?m)^error\[\w+\](?=:)": {"fg": "red", "bold": True},
    r"(?m)(?<=\| )[ \t]*\^+$": {"fg": "red"},
    r"(?m)^ *= fix:": {"fg": "green"},
    r"(?m)^ *= allowed:": {"fg": "blue"},
    r"(?m)^ *-->": {"dim": True},
}
"""Parts of a diagnostic → how they look."""


def _print(text: str, *, err: bool, nl: bool = True) -> None:
    for bar in BARS:
        bar.stop()
    click.echo(folded(text, LINE_WIDTH.get()), err=err, nl=nl)
    for bar in BARS:
        bar.start()


def wants_color(stream: Any) -> bool:
    """Colours belong on a terminal, and only where NO_COLOR is not set."""
    return bool(stream.isatty()) and not os.environ.get("NO_COLOR")


def table_looks(output: object) -> dict[str, Any]:
    """How wide a table is, and whether in colours; ``output``: the file that it goes to, if to any."""
    from safestage_eval.report.render_text import WIDTH

    return {
        "width": None if output else shutil.get_terminal_size((WIDTH, 24)).columns,
        "color": output is None and wants_color(sys.stdout),
    }


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int | None], None] | None]:
    """Progress and time left on stderr while the block runs, if stderr is a terminal.

    The bar appears with the first count.
    """
    if not sys.stderr.isatty():
        yield None
        return
    bar: Progress | None = None

    def tell(done: int, total: int | None) -> None:
        nonlocal bar
        if bar is None:
            bar = _start_bar(what)
            BARS.append(bar)
        bar.update(bar.task_ids[0], completed=done, total=total)

    try:
        yield tell
    finally:
        if bar is not None:
            bar.stop()
            BARS.remove(bar)


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """Like ``progress``, for one task of unknown length."""
    with progress(what) as tell:
        if tell is not None:
            tell(0, None)
        yield


def _start_bar(what: str) -> Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )  # fmt: skip

    bar = Progress(
        "{task.description}", BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), "left:",
        TimeRemainingColumn(),
        console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False,
    )  # fmt: skip
    bar.add_task(what, total=None)
    bar.start()
    return bar


def serve_until_interrupted(server: GuardedServer, *, browser: bool) -> None:
    """Print a server's address, open it in the ``browser`` if asked to, and serve until Ctrl+C."""
    click.echo(server.url)
    if browser:
        import webbrowser

        webbrowser.open(server.url)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        say("", err=True)
    finally:
        server.server_close()
