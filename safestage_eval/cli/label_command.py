"""``safestage label``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from shlex import join, quote
from typing import TYPE_CHECKING

import click

from .command_options import command as make
from .command_options import option
from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import allow_host_option, selected, traces_argument, where_option
from .terminal import say, say_problems, serve_until_interrupted

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef

PORT = 8350


@make("label")
def command(
    traces: tuple[str, ...] = traces_argument,
    file: Path = option(
        "Write answers to this CSV file.", "--labels", "-l", of=Output("csv"), default=Path("labels.csv")
    ),
    reviewer: str | None = option("Name the reviewer. Default: the page asks.", metavar="NAME"),
    number: int | None = option(
        "Show N rollouts, spread evenly over the stages. Default: all.", "--sample", "-n", least=1,
        metavar="N",
    ),
    seed: int = option("Choose other rollouts by another seed.", default=0),
    results: tuple[Path, ...] = option(
        "Label only the episodes in these result files; verdicts are not read. Repeatable.",
        of=click.Path(path_type=Path, dir_okay=False),
    ),
    videos: Path | None = option(
        "Look for EPISODE_ID.mp4 in this folder. Default: beside the traces.",
        of=click.Path(path_type=Path, file_okay=False, exists=True),
    ),
    by: RuleChoice = rule_options(values=False),
    where: tuple[str, ...] = where_option,
    port: int | None = option(
        f"Serve on this port. Default: {PORT}, or any that is free.", least=0, most=65535
    ),
    allow_host: tuple[str, ...] = allow_host_option,
    no_open: bool = option("Start no browser."),
) -> None:  # fmt: skip
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
    from safestage_eval.errors import InputError
    from safestage_eval.label import Ledger, Server, Session, sample
    from safestage_eval.label.review_question import unasked

    loaded, bound = by.load_rules()
    refs = sample(_episodes(traces, where, results), number, seed)
    session = Session(
        refs, loaded, Ledger(file), bound, videos,
        commands=_next([*traces, *by.binding_options()], file, results),
    )  # fmt: skip
    session.reviewer = None if reviewer is None else session.named(reviewer)
    tasks = {ref.fields.get("task") or ref.episode_id: ref for ref in reversed(refs)}
    for task, ref in tasks.items():
        if why := unasked(ref, loaded, bound):
            say(f"{task}: no requirement to show: {why}", err=True)
    try:
        server = Server(session, PORT if port is None else port, allow_host)
    except InputError:
        if port is not None:
            raise
        server = Server(session, 0, allow_host)
    so_far = count(len(session.ledger.reviewers), "reviewer") if file.exists() else ""
    answered = f", {so_far} in {file} so far" if so_far else ""
    say(f"{len(refs)} rollouts{answered}; answers go to {file}", err=True)
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

    found = selected(traces, where)
    say_problems(ref.problem for ref in found if ref.problem is not None)
    scored = {str(row["episode_id"]) for path in results for row in read_rows(path, ["episode_id"])}
    refs = [
        ref for ref in found if ref.problem is None and (not results or ref.episode_id in scored)
    ]
    if not refs:
        but = " and is in the results." if results else "."
        raise InputError(
            " ".join(traces), f"there is nothing to label: no episode can be read{but}"
        )
    return refs


def _next(scored: Sequence[str], file: Path, results: Sequence[Path]) -> tuple[str, ...]:
    """Commands to run when all is answered; ``scored``: arguments of ``score``."""
    first = [] if results else [f"safestage score {join(scored)} -f parquet -o rows.parquet"]
    files = results or [Path("rows.parquet")]
    results_options = " ".join(f"--results {quote(str(path))}" for path in files)
    return (*first, f"safestage label agreement {quote(str(file))} {results_options}")
