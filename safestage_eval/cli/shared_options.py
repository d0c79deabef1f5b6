"""Arguments that several commands share."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.line_width import LINE_WIDTH
from safestage_eval.units import LONGEST

from .outputs import STDOUT, Output
from .terminal import BARS, say

if TYPE_CHECKING:
    from rich.progress import Progress

    from safestage_eval._serving.guarded_http import GuardedServer
    from safestage_eval.formats import EpisodeRef

traces_argument = click.argument("traces", nargs=-1, required=True, metavar="TRACES...")

where_option = click.option(
    "--where", multiple=True, metavar="FIELD=VALUE",
    help="Select episodes by header field: policy=…, task=…, prompt=…, seed=…. Repeatable.",
)  # fmt: skip

episode_option = click.option(
    "--episode", "-e", "episode", metavar="ID",
    help="Choose an episode by its id, or a unique part of it, where TRACE holds several.",
)  # fmt: skip


def _unfolded(_: click.Context, __: click.Parameter, output: Path | None) -> Path | None:
    if output is not None:
        LINE_WIDTH.set(None)
    return output


output_option = click.option(
    "--output", "-o", type=Output(), callback=_unfolded,
    help="Write to this file instead of stdout.",
)  # fmt: skip

jobs_option = click.option(
    "--jobs",
    "-j",
    type=click.IntRange(1),
    metavar="N",
    help="Use N worker processes. Default: one per processor.",
)


def _set_limits(_context: click.Context, _option: click.Parameter, text: str | None) -> None:
    from safestage_eval.errors import InputError
    from safestage_eval.size_limits import VARIABLE, parse_limits

    if text is None:
        return
    try:
        parse_limits(text)
    except InputError as error:
        raise click.UsageError(str(error)) from None
    os.environ[VARIABLE] = text


limits_option = click.option(
    "--limits", metavar="NAME=NUMBER,...", expose_value=False, is_eager=True, callback=_set_limits,
    help="Read larger episodes: bodies=10000,decoded=1GB, or none (docs/security.md).",
)  # fmt: skip
"""Decorator of every command; worker processes inherit what it sets."""


def refuse_infinite(parameter: click.Parameter) -> None:
    """Make the parameter refuse NaN, infinity and numbers beyond any use, if it takes numbers."""
    if not isinstance(parameter.type, click.types.IntParamType | click.types.FloatParamType):
        return
    most = LONGEST if isinstance(parameter.type, click.types.FloatParamType) else 2**63 - 1
    usual = parameter.callback

    def checked(context: click.Context, option: click.Parameter, value: Any) -> Any:
        for number in value if isinstance(value, tuple) else (value,):
            if number is not None and not abs(number) <= most:
                raise click.BadParameter(f"too large, or not finite; {most:.0g} at most")
        return value if usual is None else usual(context, option, value)

    parameter.callback = checked


allow_host_option = click.option(
    "--allow-host", multiple=True, metavar="NAME[:PORT]",
    help="Answer under this host name too, and pages from it. Repeatable. "
    "Default: loopback names and the address reached.",
)  # fmt: skip

bootstrap_seed_option = click.option(
    "--random-seed", type=click.IntRange(0), default=0, show_default=True,
    help="Seed the bootstrap.",
)  # fmt: skip

episode_argument = click.argument("name", required=False, metavar="[EPISODE]")


def format_option(*formats: str) -> Callable[[Any], Any]:
    """``--format`` with these choices, the first one by default."""
    return click.option(
        "--format", "-f", "form", type=click.Choice(formats), default=formats[0], show_default=True
    )


def pairs(
    values: tuple[str, ...], option: str, allowed: Sequence[str] | None = None
) -> dict[str, str]:
    """``("a=b",)`` → ``{"a": "b"}``; anything else, or a name that is not allowed, is a usage error."""
    out = {}
    for value in values:
        name, equals, text = value.partition("=")
        if not equals or not name.strip():
            raise click.UsageError(f"{option} {value}: write NAME=VALUE")
        if allowed is not None and name.strip() not in allowed:
            raise click.UsageError(f"{option} {name.strip()}: there are {', '.join(allowed)}")
        out[name.strip()] = text.strip()
    return out


def selected(traces: Iterable[str], where: tuple[str, ...]) -> list[EpisodeRef]:
    """The episodes of ``TRACES...`` that ``--where`` selects."""
    from safestage_eval.formats import discover
    from safestage_eval.formats.episode_filter import Selection

    return [*Selection(discover(list(traces)), pairs(where, "--where"))]


MOST_IDS = 20
"""Ids of episodes that a message lists."""


def chosen_ref(trace: str, name: str | None, episode: str | None) -> EpisodeRef:
    """The one episode a command is about; a usage error lists the ids when it is not clear.

    ``name`` and ``episode`` are two ways to say which: as an argument, and as ``--episode``.
    """
    from safestage_eval.formats import discover

    if name is not None and episode is not None:
        raise click.UsageError(f"{name} or --episode {episode}: name the episode once")
    episode = episode or name

    refs = discover([trace])
    matches = refs
    if episode is not None:
        exact = [ref for ref in refs if ref.episode_id == episode]
        matches = exact or [ref for ref in refs if episode in ref.episode_id]
    if len(matches) == 1:
        return matches[0]
    from safestage_eval._text.printable import printable
    from safestage_eval.errors import shortened

    ids = [ref.episode_id or f"({ref.shown}, broken)" for ref in matches or refs]
    if matches:
        problem = "several episodes; name one with --episode"
    else:
        from difflib import get_close_matches

        near = get_close_matches(str(episode), ids, 3)
        near = near or [name for name in ids if get_close_matches(str(episode), name.split("."), 1)]
        problem = f"no episode {episode!r}" + (", did you mean" if near else ", but")
        ids = near or ids
    shown = "".join(f"\n  {printable(shortened(name, 200))}" for name in ids[:MOST_IDS])
    more = f"\n  and {len(ids) - MOST_IDS} more" if len(ids) > MOST_IDS else ""
    raise click.UsageError(f"{trace} holds {problem}:{shown}{more}")


def written(data: str | bytes | Iterable[str | bytes], output: Path | None) -> None:
    """Write data to stdout, or to an output as ``formats.atomic.writing``; at once or piece by piece."""
    pieces = [data] if isinstance(data, str | bytes) else data
    if output in (None, STDOUT):
        for piece in pieces:
            click.echo(piece, nl=False)
        return
    from safestage_eval.formats.atomic import writing

    try:
        with writing(output) as temporary, temporary.open("wb") as stream:
            for piece in pieces:
                stream.write(piece.encode() if isinstance(piece, str) else piece)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise click.UsageError(f"--output {output}: {error.strerror}") from None


def say_problems(problems: Iterable[object]) -> None:
    """Print each problem, or its message, as a line on stderr."""
    for problem in problems:
        say(f"problem: {getattr(problem, 'message', problem)}", err=True)


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


def wants_color(stream: Any) -> bool:
    """Colours belong on a terminal, and only where NO_COLOR is not set."""
    return bool(stream.isatty()) and not os.environ.get("NO_COLOR")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int | None], None] | None]:
    """Progress, rate and time left on stderr while the block runs, if stderr is a terminal.

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
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(TextColumn):
        """Items per second."""

        def render(self, task: Task) -> Text:
            return Text(f"{task.finished_speed or task.speed or 0:.1f}/s")

    columns = (
        TextColumn(what), BarColumn(), MofNCompleteColumn(), Rate(""), TimeElapsedColumn(),
        TextColumn("left:"), TimeRemainingColumn(),
    )  # fmt: skip
    bar = Progress(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=False,
        redirect_stderr=False,
    )  # fmt: skip
    bar.add_task(what, total=None)
    bar.start()
    return bar
