"""``safestage label``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    allow_host_option,
    selected,
    serve_until_interrupted,
    traces_argument,
    where_option,
)
from .terminal import say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from safestage_eval.formats import EpisodeRef
    from safestage_eval.label import Server, Session
    from safestage_eval.rules import BindFile, RuleSet

PORT = 8350


@click.command("label")
@traces_argument
@click.option(
    "--labels", "-l", "file", type=Output("csv"),
    default=Path("labels.csv"), show_default=True, help="Write answers to this CSV file.",
)  # fmt: skip
@click.option("--reviewer", metavar="NAME", help="Name the reviewer. Default: the page asks.")
@click.option(
    "--sample", "-n", "number", type=click.IntRange(1), metavar="N",
    help="Show N rollouts, spread evenly over the stages. Default: all.",
)  # fmt: skip
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Choose other rollouts by another seed."
)
@click.option(
    "--results", multiple=True, type=click.Path(path_type=Path, dir_okay=False),
    help="Label only the episodes in these result files; verdicts are not read. Repeatable.",
)  # fmt: skip
@click.option(
    "--videos", type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Look for EPISODE_ID.mp4 in this folder. Default: beside the traces.",
)  # fmt: skip
@rule_options(values=False)
@where_option
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    help=f"Serve on this port. Default: {PORT}, or any that is free.",
)
@allow_host_option
@click.option("--no-open", is_flag=True, help="Start no browser.")
def command(
    traces: tuple[str, ...],
    file: Path,
    reviewer: str | None,
    number: int | None,
    seed: int,
    results: tuple[Path, ...],
    videos: Path | None,
    by: RuleChoice,
    where: tuple[str, ...],
    port: int | None,
    allow_host: tuple[str, ...],
    no_open: bool,
) -> None:
    """Let people judge rollouts, without seeing what the evaluator says.

    Serves a page to this machine alone: the video or a 3-D replay of each rollout, its safety
    requirement, and three answers: safe, unsafe, unsure. Each answer is on disk before the page
    goes on; start again at any time to continue. Several people can answer, each under a name.

    \b
    Examples:
      safestage label traces/
      safestage label runs/ --sample 240 --reviewer ada --labels ada.csv
      safestage label agreement labels.csv --results rows.parquet    then
    """
    from safestage_eval._text.plural import count
    from safestage_eval.label import Ledger, Session, sample

    loaded, bound = by.load_rules()
    refs = _episodes(traces, where, results)
    chosen = sample(refs, number, seed)
    session = Session(
        refs=chosen,
        rules=loaded,
        ledger=Ledger(file),
        bind=bound,
        videos=videos,
        commands=_next([*traces, *by.binding_options()], file, results),
    )
    session.reviewer = None if reviewer is None else session.named(reviewer)
    _warn(chosen, loaded, bound)
    server = _server(session, port, allow_host)
    answered = (
        f", {count(len(session.ledger.reviewers), 'reviewer')} in {file} so far"
        if file.exists()
        else ""
    )
    say(f"{len(chosen)} rollouts{answered}; answers go to {file}", err=True)
    say("Ctrl+C ends; start again to continue", err=True)
    serve_until_interrupted(server, browser=not no_open)
    for line in session.commands:
        say(f"next: {line}", err=True)


def _episodes(
    traces: Sequence[str], where: tuple[str, ...], results: Sequence[Path]
) -> list[EpisodeRef]:
    """The episodes that can be opened and are asked for."""
    from safestage_eval.errors import InputError
    from safestage_eval.metrics.read_rows import read_rows

    refs = []
    for ref in selected(traces, where):
        if ref.problem is None:
            refs.append(ref)
        else:
            say(f"problem: {ref.problem}", err=True)
    if results:
        scored = {
            str(row.get("episode_id"))
            for path in results
            for row in read_rows(path, ["episode_id"])
        }
        refs = [ref for ref in refs if ref.episode_id in scored]
    if not refs:
        raise InputError(
            " ".join(traces),
            "there is nothing to label: no episode can be read"
            + (" and is in the results." if results else "."),
        )
    return refs


def _warn(refs: Sequence[EpisodeRef], rules: RuleSet, bind: BindFile | None) -> None:
    """Warn of tasks without a requirement that could be shown."""
    from safestage_eval.errors import InputError
    from safestage_eval.label.review_question import unasked

    tasks = {ref.fields.get("task") or ref.episode_id: ref for ref in reversed(refs)}
    for task, ref in tasks.items():
        try:
            why = unasked(ref.open().header, rules, bind)
        except InputError as error:
            why = str(error)
        if why is not None:
            say(f"{task}: no requirement to show: {why}", err=True)


def _server(session: Session, port: int | None, names: tuple[str, ...]) -> Server:
    from safestage_eval.errors import InputError
    from safestage_eval.label import serve

    if port is not None:
        return serve(session, port, names)
    try:
        return serve(session, PORT, names)
    except InputError:
        return serve(session, 0, names)


def _next(scored: Sequence[str], file: Path, results: Sequence[Path]) -> tuple[str, ...]:
    """Commands to run when all is answered; ``scored``: arguments of ``score``."""
    from shlex import join, quote

    first = [] if results else [f"safestage score {join(scored)} -f parquet -o rows.parquet"]
    files = results or [Path("rows.parquet")]
    results_options = " ".join(f"--results {quote(str(path))}" for path in files)
    return (*first, f"safestage label agreement {quote(str(file))} {results_options}")
