"""``safestage report tables``."""

from __future__ import annotations

from pathlib import Path

from safestage_eval.report import TABLE_FORMATS

from .command_options import argument, option
from .command_options import command as make
from .outputs import written
from .shared_options import format_option, output_option, random_seed_option
from .terminal import say

MOST = 20
"""Problems listed on stderr; the JSON has all of them."""


@make("tables")
def command(
    results: tuple[str, ...] = argument("RESULTS...", required=True),
    form: str = format_option(*TABLE_FORMATS, "latex"),
    output: Path | None = output_option,
    intervals: str = option(
        "Add 95 % intervals to the tables; JSON and CSV have both kinds.",
        of=("none", "wilson", "bootstrap"), default="none",
    ),
    random_seed: int = random_seed_option,
    strict: bool = option("Exit 1 if cells are missing, unequal or undecided."),
) -> int:  # fmt: skip
    """Tabulate a campaign: by policy, by stage, by family.

    RESULTS are files that score wrote as json, jsonl, csv or parquet, or outcome tables: any table
    with the columns task, stage, policy, prompt, seed, rollout, success, violation and, if there
    are any, family. Several files are one table.

    Rates are in percent: the mean over environment seeds of the seed's rate, and its sample
    standard deviation. A duplicate row is an error. Cells that are missing, or have more
    or fewer rollouts than the others, are reported on stderr and in the JSON.

    \b
    Examples:
      safestage report tables rows.parquet
      safestage report tables pi05.jsonl groot.jsonl --intervals bootstrap
      safestage report tables outcomes.csv -f latex -o tables.tex
      safestage report tables outcomes.csv -f json --strict | jq .by_stage
    """
    from safestage_eval.metrics import aggregate, read_outcomes
    from safestage_eval.report.aggregate_report import Drawing, render

    outcomes = [o for group in read_outcomes(results).values() for o in group]
    result = aggregate(outcomes)
    written(render(result, form, Drawing(intervals, random_seed)), output)
    for problem in result.problems[:MOST]:
        say(f"uneven: {problem.message}", err=True)
    if len(result.problems) > MOST:
        say(f"uneven: and {len(result.problems) - MOST} more (--format json)", err=True)
    return 1 if strict and result.problems else 0
