"""``safestage label agreement``."""

from __future__ import annotations

from pathlib import Path

import click

from .command_options import argument, option
from .command_options import command as make
from .outputs import written
from .shared_options import format_option, output_option
from .terminal import say


@make("agreement")
def command(
    labels: tuple[str, ...] = argument("LABELS...", required=True),
    results: tuple[str, ...] = option(
        "Read verdicts from a file that score wrote. Repeatable.",
        of=click.Path(), required=True, metavar="RESULTS",
    ),
    reviewer: tuple[str, ...] = option(
        "Use only this reviewer's labels. Repeatable.", metavar="NAME"
    ),
    form: str = format_option("table", "json", "csv"),
    output: Path | None = output_option,
) -> None:  # fmt: skip
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
    reviewers = sorted({label.reviewer for label in given})
    for name in reviewer:
        if name not in reviewers:
            raise InputError(f"--reviewer {name}", "no label is theirs.", ", ".join(reviewers))
    given = [label for label in given if not reviewer or label.reviewer in reviewer]
    result = agreement(given, read_outcomes(results, wanted=FOR_LABELS)[""])
    written(render(result, form), output)
    if form == "csv" and result.only_labels:
        say(f"labels without a result: {len(result.only_labels)}", err=True)
    if form == "csv" and result.only_results:
        say(f"results without a label: {len(result.only_results)}", err=True)
