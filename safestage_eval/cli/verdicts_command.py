"""``safestage compare verdicts``."""

from __future__ import annotations

from pathlib import Path

import click

from .command_options import argument, option
from .command_options import command as make
from .outputs import written
from .rule_choice import RuleChoice, rule_options
from .shared_options import format_option, jobs_option, output_option, selected, where_option
from .terminal import progress


@make("verdicts")
def command(
    what: tuple[str, ...] = argument("BEFORE AFTER | TRACES...", required=True),
    by: RuleChoice = rule_options(),
    against: tuple[str, ...] = option(
        "Judge the second time by these rules. Default: those of --rules. Repeatable.",
        "-a", of=click.Path(), metavar="RULES",
    ),
    where: tuple[str, ...] = where_option,
    form: str = format_option("table", "json"),
    output: Path | None = output_option,
    fail_on_change: bool = option("Exit 1 if any verdict changed."),
    jobs: int | None = jobs_option,
) -> int:  # fmt: skip
    """Say which verdicts flipped, and what flipped each.

    BEFORE and AFTER are result files that score wrote as json, jsonl, csv or parquet. For each
    flipped verdict it says whether the trace, the rule or the evaluator changed.

    With --against or --set, TRACES are judged twice: by --rules, then by --against with --set
    applied. For each flipped verdict the differences between the two are tried one at a time, then
    in pairs: the smallest set that flips the verdict is named. Where no two suffice, those are named
    that cannot be left out.

    With --set and rows.parquet of score --what-if, the what-if table beside it says which verdicts
    flip; only episodes that it does not decide are judged again.

    \b
    Examples:
      safestage compare verdicts old.jsonl new.jsonl
      safestage compare verdicts traces/ --rules fsh --against my_fsh.toml
      safestage compare verdicts traces/ --rules fsh --set edge="4 cm"
      safestage compare verdicts rows.parquet --set edge="4 cm"
      safestage compare verdicts traces/ -r old/ -a new/ --fail-on-change
    """
    from safestage_eval.report import flips_report
    from safestage_eval.whatif.diff import diff, diff_table
    from safestage_eval.whatif.flip_table import FlipTable, is_result_file
    from safestage_eval.whatif.result_difference import difference, read_results

    with progress("comparing") as tell:
        if by.settings and len(what) == 1 and is_result_file(what[0]):
            if against or by.rules or by.bind or where:
                raise click.UsageError(
                    f"{what[0]}: its what-if table holds for the rules that it was written with; leave "
                    "out --rules, --against, --bind and --where"
                )
            found = diff_table(FlipTable(what[0]), by.overrides, jobs=jobs, progress=tell)
        elif against or by.settings:
            found = diff(
                selected(what, where), by.specs, list(against) or by.specs, overrides=by.overrides,
                bind=by.bind, jobs=jobs, progress=tell,
            )  # fmt: skip
        elif by or where:
            raise click.UsageError(
                "--rules, --bind and --where are about traces: name the other rules with --against, "
                "or other values with --set"
            )
        elif len(what) != 2 or any(Path(file).is_dir() for file in what):
            raise click.UsageError(
                "give two result files, BEFORE and AFTER; or traces, with --rules and --against"
            )
        else:
            found = difference(read_results(what[0]), read_results(what[1]))
    written(flips_report.render(found, form), output)
    return 2 if found.problems else 1 if fail_on_change and not found.empty else 0
