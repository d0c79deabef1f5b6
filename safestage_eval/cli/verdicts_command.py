"""``safestage compare verdicts``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    jobs_option,
    output_option,
    progress,
    selected,
    where_option,
    written,
)


@click.command("verdicts")
@click.argument("what", nargs=-1, required=True, metavar="BEFORE AFTER | TRACES...")
@rule_options()
@click.option(
    "--against", "-a", type=click.Path(), multiple=True, metavar="RULES",
    help="Judge the second time by these rules. Default: those of --rules. Repeatable.",
)  # fmt: skip
@where_option
@format_option("table", "json")
@output_option
@click.option("--fail-on-change", is_flag=True, help="Exit 1 if any verdict changed.")
@jobs_option
@click.pass_context
def command(
    ctx: click.Context,
    what: tuple[str, ...],
    by: RuleChoice,
    against: tuple[str, ...],
    where: tuple[str, ...],
    form: str,
    output: Path | None,
    fail_on_change: bool,
    jobs: int | None,
) -> None:
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
    from safestage_eval.whatif.flip_table import is_result_file

    if by.settings and len(what) == 1 and is_result_file(what[0]):
        if against or by.rules or by.bind or where:
            raise click.UsageError(
                f"{what[0]}: its what-if table holds for the rules that it was written with; leave out "
                "--rules, --against, --bind and --where"
            )
        difference = _of_table(what[0], by.overrides, jobs)
    elif against or by.settings:
        difference = _of_rules(what, by, against, where, jobs)
    else:
        difference = _of_results(what, by, where)
    written(flips_report.render(difference, form), output)
    ctx.exit(2 if difference.problems else 1 if fail_on_change and not difference.empty else 0)


def _of_table(path: str, overrides: dict[str, str], jobs: int | None) -> Any:
    from safestage_eval.whatif.diff import diff_table
    from safestage_eval.whatif.flip_table import FlipTable

    with progress("comparing") as tell:
        return diff_table(FlipTable(path), overrides, jobs=jobs, progress=tell)


def _of_rules(
    traces: tuple[str, ...],
    by: RuleChoice,
    against: tuple[str, ...],
    where: tuple[str, ...],
    jobs: int | None,
) -> Any:
    from safestage_eval.whatif.diff import diff

    refs = selected(traces, where)
    with progress("comparing") as tell:
        return diff(
            refs,
            by.specs,
            list(against) or by.specs,
            overrides=by.overrides,
            bind=by.bind,
            jobs=jobs,
            progress=tell,
        )


def _of_results(files: tuple[str, ...], by: RuleChoice, where: tuple[str, ...]) -> Any:
    if by or where:
        raise click.UsageError(
            "--rules, --bind and --where are about traces: name the other rules with --against, "
            "or other values with --set"
        )
    if len(files) != 2 or any(Path(file).is_dir() for file in files):
        raise click.UsageError(
            "give two result files, BEFORE and AFTER; or traces, with --rules and --against"
        )
    from safestage_eval.whatif.result_difference import difference, read_results

    before, after = map(read_results, files)
    return difference(before, after)
