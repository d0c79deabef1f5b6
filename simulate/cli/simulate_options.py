"""Options, errors and progress that the commands share."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval.errors import InputError

if TYPE_CHECKING:
    from simulate.tasks.task import Task

PROMPTS = ("default", "generic", "specific")


class BadInput(click.ClickException):
    """Says what is wrong and exits with 2, like wrong usage."""

    exit_code = 2


def explains(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command whose InputErrors are printed as messages instead of tracebacks."""

    @wraps(command)
    def run(*args: Any, **options: Any) -> Any:
        try:
            return command(*args, **options)
        except InputError as error:
            raise BadInput(str(error)) from None

    return run


def numbers(text: str) -> tuple[int, ...]:
    """``0,1,2`` or ``0-9`` → numbers. Raises click.BadParameter for what is neither."""
    out: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdigit() or (dash and not last.isdigit()):
            raise click.BadParameter(f"{part!r} is no seed: write 0,1,2 or 0-9")
        if dash and int(last) < int(first):
            raise click.BadParameter(f"{part!r} runs backwards: write {last}-{first}")
        out += range(int(first), int(last or first) + 1)
    return tuple(dict.fromkeys(out))


def seeds_option(help_text: str) -> Callable[..., Any]:
    """``--seeds``."""
    return click.option(
        "--seeds",
        default="0,1,2",
        show_default=True,
        callback=lambda _context, _option, text: numbers(text),
        help=help_text,
    )


robot_option = click.option(
    "--robot-mjcf",
    type=click.Path(path_type=Path, dir_okay=False),
    envvar="SAFESTAGE_ROBOT_MJCF",
    help="MJCF of the DROID arm to use instead of the bundled one.",
)

jobs_option = click.option(
    "--jobs",
    type=click.IntRange(1),
    default=lambda: len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1,
    show_default="one per processor",
    help="Number of worker processes.",
)


def _share(_context: click.Context, _option: click.Parameter, text: str | None) -> Any:
    """``2/3`` → (2, 3)."""
    if text is None:
        return None
    part, _, parts = text.partition("/")
    if not (part.isdigit() and parts.isdigit() and 1 <= int(part) <= int(parts)):
        raise click.BadParameter(f"{text!r} is no share: write 1/3, 2/3 or 3/3")
    return int(part), int(parts)


share_option = click.option(
    "--share", callback=_share, metavar="K/N", help="Only every Nth task, starting at the Kth."
)


def chosen_tasks(names: tuple[str, ...]) -> list[Task]:
    """Tasks by id, file or pattern (``fsh_*``); all without one. Raises InputError."""
    from simulate.tasks.task import tasks, tasks_matching

    return tasks_matching(names) if names else list(tasks().values())


@contextmanager
def progress(total: int, unit: str) -> Iterator[Callable[[int], None]]:
    """Count, rate and time left, in a line on stderr; silent where nobody watches."""
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield lambda _done: None
        return
    from rich.console import Console

    start = time.monotonic()
    with Console(stderr=True).status(f"{unit} 1 of {total}") as status:

        def show(done: int) -> None:
            status.update(progress_line(done, total, unit, time.monotonic() - start))

        yield show


def progress_line(done: int, total: int, unit: str, seconds: float) -> str:
    """``episode 12 of 90, 20 a minute, 4 min left``."""
    if not done or seconds <= 0:
        return f"{unit} {done} of {total}"
    left = seconds / done * (total - done)
    span = f"{left / 60:.0f} min" if left >= 90 else f"{left:.0f} s"
    return f"{unit} {done} of {total}, {60 * done / seconds:.3g} a minute, {span} left"
