"""``safestage sweep slack``."""

from __future__ import annotations

from pathlib import Path

from .command_options import command as make
from .command_options import option
from .outputs import written
from .shared_options import format_option, output_option


@make("slack")
def command(
    rows: str,
    params: tuple[str, ...] = option(
        "Show only this parameter. Repeatable. Default: all in the what-if table.",
        "--param", "-p", metavar="NAME",
    ),
    form: str = format_option("table", "csv", "json"),
    output: Path | None = output_option,
) -> None:  # fmt: skip
    """Say how far each parameter may move before a verdict flips.

    ROWS is a result file, rows.parquet of score --what-if. The table gives, per parameter, rule and
    verdict, how many verdicts flip when the parameter falls or rises, and the least and the median
    distance; CSV and JSON have a row for each verdict, in SI.

    \b
    Examples:
      safestage sweep slack rows.parquet
      safestage sweep slack rows.parquet -p min_clearance -p edge
      safestage sweep slack rows.parquet -p edge -f csv
    """
    from safestage_eval.report.sweep_report import render_slack
    from safestage_eval.rules import load_rules
    from safestage_eval.whatif.flip_table import FlipTable, slack

    table = FlipTable(rows)
    rules = load_rules(list(table.judging.rules))
    written(render_slack(slack(table, params), rules, form), output)
