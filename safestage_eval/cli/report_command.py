"""``safestage report``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .command_options import argument, option
from .command_options import command as make
from .outputs import Output, written
from .rule_choice import RuleChoice, rule_options
from .shared_options import jobs_option
from .terminal import progress, say, say_problems

if TYPE_CHECKING:
    from safestage_eval.viewer.campaign.overview import Report

PAGES = (".html", ".htm")
"""Endings of an output that is one file; anything else is a folder."""


@make("report")
def command(
    results: Path = argument("RESULTS|RUN"),
    traces: tuple[str, ...] = argument("[TRACES...]"),
    output: Path = option(
        "Write one page (NAME.html), or a folder with index.html.",
        "-o", of=Output("html", folder=True, emptied=True), default=Path("report.html"),
    ),
    title: str = option("Title the page.", metavar="TEXT", default="Safety report"),
    by: RuleChoice = rule_options(),
    sections: int | None = option(
        "Give the evidence of at most N episodes, gravest first. Default: 250 in one page, all in a "
        "folder.",
        least=0, metavar="N",
    ),
    jobs: int | None = jobs_option,
) -> int:  # fmt: skip
    """Write the run browser as files: results, list of episodes, and their evidence.

    RESULTS is a file of safestage score (json, jsonl, csv, parquet), or a bare table of outcomes.
    With TRACES, the episodes that were scored, each can be opened: 3-D replay, signals with limits,
    phases and findings. Instead of RESULTS, a RUN (traces) is judged first. Rules, bind file and
    --set should be those that the results were made with. Nothing needs a network or a server: a
    page carries everything; a folder loads each episode when it is opened, and takes thousands.

    \b
    Examples:
      safestage score traces/ --format parquet --output results.parquet
      safestage report results.parquet traces/ --output report.html
      safestage report runs/ --output report/
      safestage report outcomes.csv --title "Three policies, 97 tasks"
    """
    from safestage_eval.viewer.campaign.campaign_data import compose, judged

    make: Callable[..., Report]
    if _is_run(results):
        from safestage_eval.formats import discover

        refs = discover([results, *traces])
        make = partial(judged, refs, by.load(), title, results.name, jobs=jobs)
    else:
        settings = by.load() if traces else None
        make = partial(compose, results, traces, settings, title=title, jobs=jobs)

    report, page = write_report(make, output, sections)
    drawn = report.pieces
    with_evidence = f", {len(drawn.names)} with evidence" if drawn is not None else ""
    size = page.stat().st_size + (drawn.bytes if drawn is not None and page != output else 0)
    rollouts = len(report.counts.outcomes)
    say(f"{page}: {rollouts} rollouts{with_evidence}, {size / 1e6:.1f} MB", err=True)
    for note in report.notes:
        say(f"note: {note}", err=True)
    problems = drawn.problems if drawn is not None else ()
    say_problems(problems)
    return 2 if problems else 0


def write_report(
    make: Callable[..., Report], output: Path, most: int | None
) -> tuple[Report, Path]:
    """Make a report and write it: one file for an output that ends like one, else a folder.

    ``make`` takes the folder of the evidence, how many episodes have it at most, and progress.
    Returns the report, and the page to open.
    """
    from safestage_eval.formats.atomic import is_stream
    from safestage_eval.viewer.campaign.campaign_data import MOST
    from safestage_eval.viewer.run_report import prepared, report_page, write_folder

    if output.suffix.lower() in PAGES or is_stream(output):
        with progress("drawing") as tell:
            report = make(folder=None, most=MOST if most is None else most, progress=tell)
        written(report_page(report), output)
        return report, output
    try:
        with progress("drawing") as tell:
            report = make(folder=prepared(output), most=most, progress=tell)
        return report, write_folder(report, output)
    except OSError as error:
        raise click.UsageError(f"--output {output}: {error.strerror}") from None


def _is_run(path: Path) -> bool:
    """Whether a path is of traces, not of results."""
    from safestage_eval.formats.discover import MCAP_MAGIC

    if path.is_dir():
        return True
    try:
        with path.open("rb") as file:
            head = file.read(len(MCAP_MAGIC))
    except OSError:
        return False
    return head == MCAP_MAGIC or head.startswith(b"PK\x03\x04")
