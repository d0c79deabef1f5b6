"""``safestage report``."""

from __future__ import annotations

from pathlib import Path

import click

from .shared_options import (
    bind_option,
    jobs_option,
    pairs,
    prepare_kernels,
    progress,
    rules_option,
    set_option,
    written,
)
from .terminal import say


@click.command("report")
@click.argument("results", type=click.Path(path_type=Path))
@click.argument("traces", nargs=-1, metavar="[TRACES...]")
@click.option(
    "--output", "-o", type=click.Path(path_type=Path), default=Path("report.html"),
    show_default=True, help="Write the page to this file.",
)  # fmt: skip
@click.option("--title", metavar="TEXT", help="Title the page. Default: Safety report.")
@rules_option
@bind_option
@set_option
@click.option(
    "--sections", type=click.IntRange(0), metavar="N", default=500, show_default=True,
    help="Draw at most N episodes, gravest first.",
)  # fmt: skip
@jobs_option
@click.pass_context
def command(
    ctx: click.Context,
    results: Path,
    traces: tuple[str, ...],
    output: Path,
    title: str | None,
    rules: tuple[str, ...],
    bind: Path | None,
    settings: tuple[str, ...],
    sections: int,
    jobs: int | None,
) -> None:
    """Write one HTML page with the results of a campaign.

    RESULTS is a file of safestage score (json, jsonl, csv, parquet), or a bare table of outcomes.
    With TRACES, the episodes that were scored, the page also has a section for each: its
    measurements over time with their limits, the key frame, and how the rates move with the limits.
    The page is self-contained: it needs no network, no server and no other file. Rules, bind
    file and --set should be those that the results were made with.

    \b
    Examples:
      safestage score traces/ --format parquet --output results.parquet
      safestage report results.parquet traces/ --output report.html
      safestage report outcomes.csv --title "Three policies, 97 tasks"
    """
    from safestage_eval.viewer.campaign.campaign_data import compose
    from safestage_eval.viewer.campaign.campaign_page import build

    if traces:
        prepare_kernels()
    with progress("drawing") as tell:
        report = compose(
            results,
            traces,
            rules,
            title=title,
            overrides=pairs(settings, "--set"),
            bind=bind,
            most=sections,
            jobs=jobs,
            progress=tell,
        )
    html = build(report)
    written(html, output)
    drawn = report.sections
    with_sections = f", {len(drawn.html)} with sections" if drawn is not None else ""
    size = len(html.encode()) / 1e6
    say(f"{output}: {len(report.counts.outcomes)} rollouts{with_sections}, {size:.1f} MB", err=True)
    for note in report.notes:
        say(f"note: {note}", err=True)
    problems = drawn.problems if drawn is not None else ()
    for problem in problems:
        say(f"problem: {problem.message}", err=True)
    ctx.exit(2 if problems else 0)
