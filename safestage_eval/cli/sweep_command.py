"""``safestage sweep``."""

from __future__ import annotations

from pathlib import Path

import click

from .command_options import command as make
from .command_options import option
from .outputs import Output, written
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    jobs_option,
    output_option,
    selected,
    traces_argument,
    where_option,
)
from .terminal import progress, say, say_problems

CURVES = ("policy", "prompt", "stage", "task", "rule")


@make("sweep")
def command(
    traces: tuple[str, ...] = traces_argument,
    by: RuleChoice = rule_options(),
    param: str = option("Vary this parameter.", "-p", metavar="NAME", required=True),
    first: str | None = option(
        "Begin at this value, with its unit. Default: 0.", "--from", metavar="VALUE"
    ),
    last: str | None = option(
        "End at this value. Default: twice the default value.", "--to", metavar="VALUE"
    ),
    steps: int = option("Judge N values, both ends included.", least=2, metavar="N", default=41),
    values: str | None = option('Judge these values instead: "1 cm, 2 cm, 5 cm".', metavar="LIST"),
    curve_fields: tuple[str, ...] = option(
        "Draw one curve per value of this field. Repeatable.", "--by", of=CURVES
    ),
    form: str = format_option("table", "csv", "json"),
    output: Path | None = output_option,
    plot: Path | None = option(
        "Draw VR and SSR as well: curve.png, curve.svg.", of=Output("png", "svg", "pdf")
    ),
    where: tuple[str, ...] = where_option,
    jobs: int | None = jobs_option,
) -> int:
    """Show how the rates move with a threshold.

    Every value is judged, but the traces are read and measured only once. TRACES may also be
    rows.parquet of score --what-if: then the what-if table beside it answers, and only episodes
    that it does not decide are judged again.

    Episodes count if a rule that is assigned to them reads the parameter. In the table,
    neighbouring values with equal rates share a row; CSV and JSON have a row for each, in SI. JSON
    also says, per episode, between which two values its verdict flips.

    \b
    Examples:
      safestage sweep traces/ --rules ets --param min_clearance
      safestage sweep traces/ -r ets -p min_clearance --from "1 cm" --to "20 cm"
      safestage sweep traces/ -p edge --values "1 cm, 2 cm, 5 cm" --by policy
      safestage sweep rows.parquet -p min_clearance --steps 200
      safestage sweep traces/ -p settle_time --to "3 s" --plot settle.png
    """
    if values is not None and (first is not None or last is not None):
        raise click.UsageError("--values: the values themselves, so leave out --from and --to")
    if param in by.overrides:
        raise click.UsageError(f"--set {param}: it is swept; leave one of the two out")
    from safestage_eval.report import sweep_report
    from safestage_eval.report.figure import ready
    from safestage_eval.rules import load_rules
    from safestage_eval.whatif.flip_table import FlipTable, is_result_file
    from safestage_eval.whatif.sweep import sweep, sweep_table
    from safestage_eval.whatif.swept_values import between, chosen

    if plot is not None:
        ready("--plot", plot)
    table = None
    if len(traces) == 1 and is_result_file(traces[0]):
        if by or where:
            raise click.UsageError(
                f"{traces[0]}: its what-if table holds for the rules and values that it was written "
                "with; leave out --rules, --set, --bind and --where"
            )
        table = FlipTable(traces[0])
    specs = by.specs if table is None else list(table.judging.rules)
    loaded = load_rules(specs)
    visited = (
        between(loaded, param, first, last, steps)
        if values is None
        else chosen(loaded, param, values.split(","))
    )
    with progress("sweeping") as tell:
        if table is not None:
            curves = sweep_table(table, param, visited, jobs=jobs, progress=tell)
        else:
            curves = sweep(
                selected(traces, where), specs, param, visited, overrides=by.overrides,
                bind=by.bind, jobs=jobs, progress=tell,
            )  # fmt: skip
    written(sweep_report.render(curves, form, curve_fields), output)
    if plot is not None:
        sweep_report.plot(curves, plot, curve_fields)
        say(f"{plot}: drawn", err=True)
    say_problems(curves.problems if form != "table" else ())
    return 2 if curves.problems else 0
