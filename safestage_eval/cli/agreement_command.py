"""``safestage label agreement``."""

from __future__ import annotations

from pathlib import Path

import click

from .shared_options import format_option, output_option, written
from .terminal import say


@click.command("agreement")
@click.argument("labels", nargs=-1, required=True, metavar="LABELS...")
@click.option(
    "--results", type=click.Path(), required=True, multiple=True, metavar="RESULTS",
    help="Read verdicts from a file that score wrote. Repeatable.",
)  # fmt: skip
@click.option(
    "--reviewer", multiple=True, metavar="NAME", help="Use only this reviewer's labels. Repeatable."
)
@format_option("table", "json", "csv")
@output_option
def command(
    labels: tuple[str, ...],
    results: tuple[str, ...],
    reviewer: tuple[str, ...],
    form: str,
    output: Path | None,
) -> None:
    """Compare verdicts with labels by people.

    LABELS are tables (CSV, Parquet, JSON) with the columns episode_id and label, which is safe,
    unsafe or unsure, and perhaps reviewer and note: what "safestage label" writes. RESULTS are
    files that score wrote, or tables with the columns episode_id, stage and violation.

    Precision, recall, F1 and Cohen's kappa have violations as the positive class. With
    several reviewers the majority counts; their agreement with each other is reported too.

    \b
    Examples:
      safestage label agreement labels.csv --results rows.parquet
      safestage label agreement ada.csv bob.csv --results rows.jsonl -f json
    """
    from safestage_eval.errors import InputError
    from safestage_eval.metrics.agreement import agreement
    from safestage_eval.metrics.labels import read_labels
    from safestage_eval.metrics.outcome_rows import FOR_LABELS, read_outcomes
    from safestage_eval.report.agreement_report import render

    several = len(labels) > 1  # then a file without names is a reviewer
    given = [
        label for path in labels for label in read_labels(path, Path(path).stem if several else "")
    ]
    if reviewer:
        reviewers = sorted({label.reviewer for label in given})
        for name in reviewer:
            if name not in reviewers:
                raise InputError(f"--reviewer {name}", "no label is theirs.", ", ".join(reviewers))
        given = [label for label in given if label.reviewer in reviewer]
    result = agreement(given, read_outcomes(results, wanted=FOR_LABELS)[""])
    written(render(result, form), output)
    if form == "csv":
        for missing, names in (
            ("labels without a result", result.only_labels),
            ("results without a label", result.only_results),
        ):
            if names:
                say(f"{missing}: {len(names)}", err=True)
