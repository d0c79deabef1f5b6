"""``safestage report``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    jobs_option,
    progress,
    say_problems,
    written,
)
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.viewer.campaign.overview import Report

PAGES = (".html", ".htm")
"""Endings of an output that is one file; anything else is a folder."""


@click.command("report")
@click.argument("results", type=click.Path(path_type=Path), metavar="RESULTS|RUN")
@click.argument("traces", nargs=-1, metavar="[TRACES...]")
@click.option(
    "--output", "-o", type=Output("html", folder=True, emptied=True), default=Path("report.html"),
    show_default=True, help="Write one page (NAME.html), or a folder with index.html.",
)  # fmt: skip
@click.option("--title", metavar="TEXT", help="Title the page. Default: Safety report.")
@rule_options()
@click.option(
    "--sections", type=click.IntRange(0), metavar="N",
    help="Give the evidence of at most N episodes, gravest first. Default: 250 in one page, all in a folder.",
)  # fmt: skip
@jobs_option
@click.pass_context
def command(
    ctx: click.Context,
    results: Path,
    traces: tuple[str, ...],
    output: Path,
    title: str | None,
    by: RuleChoice,
    sections: int | None,
    jobs: int | None,
) -> None:
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

    heading = title or "Safety report"
    if _is_run(results):
        from safestage_eval.formats import discover

        refs = discover([results, *traces])
        make: Callable[..., Report] = partial(
            judged, refs, by.load(), heading, results.name, jobs=jobs
        )
    else:
        settings = by.load() if traces else None
        make = partial(compose, results, traces, settings, title=heading, jobs=jobs)

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
    ctx.exit(2 if problems else 0)


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
