"""``safestage aggregate``."""

from __future__ import annotations

from pathlib import Path

import click

from .shared_options import written

MOST = 20
"""Problems told one by one on stderr; all of them are in the JSON."""


@click.command("aggregate")
@click.argument("results", nargs=-1, required=True, metavar="RESULTS...")
@click.option(
    "--format", "-f", "form", default="table", show_default=True,
    type=click.Choice(["table", "json", "csv", "markdown", "latex"]),
)  # fmt: skip
@click.option(
    "--output", "-o", type=click.Path(path_type=Path), help="Write to this file instead of stdout."
)
@click.option(
    "--intervals", type=click.Choice(["none", "wilson", "bootstrap"]), default="none",
    show_default=True, help="Method of the 95 % intervals in tables; JSON and CSV contain both.",
)  # fmt: skip
@click.option(
    "--resamples", type=click.IntRange(100), default=2000, show_default=True,
    help="Number of bootstrap resamples over tasks.",
)  # fmt: skip
@click.option(
    "--random-seed", type=click.IntRange(0), default=0, show_default=True,
    help="Random seed of the bootstrap.",
)  # fmt: skip
@click.option("--strict", is_flag=True, help="Exit 1 if cells are missing, unequal or undecided.")
@click.pass_context
def command(
    ctx: click.Context,
    results: tuple[str, ...],
    form: str,
    output: Path | None,
    intervals: str,
    resamples: int,
    random_seed: int,
    strict: bool,
) -> None:
    """Make the result tables of a campaign: by policy, by stage, by family.

    RESULTS are files that score wrote as json, jsonl, csv or parquet, or outcome tables: any table
    with the columns task, stage, policy, prompt, seed, rollout, success, violation and, if there
    are any, family. Several files are one table.

    Rates are in percent: the mean over environment seeds of the seed's rate, and its sample
    standard deviation. A duplicate row is an error. Cells that are missing, or have more
    or fewer rollouts than the others, are reported on stderr and in the JSON.

    \b
    Examples:
      safestage aggregate rows.parquet
      safestage aggregate pi05.jsonl groot.jsonl --intervals bootstrap
      safestage aggregate outcomes.csv -f latex -o tables.tex
      safestage aggregate outcomes.csv -f json --strict | jq .by_stage
    """
    from safestage_eval.metrics import aggregate, read_outcomes
    from safestage_eval.report.aggregate_report import Drawing, render

    outcomes = [o for group in read_outcomes(results).values() for o in group]
    found = aggregate(outcomes)
    written(render(found, form, Drawing(intervals, random_seed, resamples)), output)
    for problem in found.problems[:MOST]:
        click.echo(f"uneven: {problem.message}", err=True)
    if len(found.problems) > MOST:
        click.echo(f"uneven: and {len(found.problems) - MOST} more (--format json)", err=True)
    ctx.exit(1 if strict and found.problems else 0)
