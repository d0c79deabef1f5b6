"""``safestage compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from safestage_eval.report import TABLE_FORMATS

from .command_options import argument, option
from .command_options import command as make
from .outputs import written
from .shared_options import format_option, output_option, pairs, random_seed_option
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.metrics import Outcome
    from safestage_eval.metrics.paired import By

    Sides = dict[str, list[Outcome]]

FIELDS = ("task", "stage", "family", "policy", "prompt", "seed", "rollout")


@make("compare")
def command(
    results: tuple[str, ...] = argument("A [B]", required=True),
    by: By | None = option(
        "Compare two policies, prompts or rule sets of one file. With two files, the default is one "
        "side per file.",
        of=("policy", "prompt", "rules"),
    ),
    between: tuple[str, str] | None = option(
        "Compare these two policies, prompts or rule sets, where a file has more.",
        nargs=2, metavar="FIRST SECOND", multiple=False,
    ),
    where: tuple[str, ...] = option(
        "Select outcomes: policy=…, prompt=…, stage=…, task=…, seed=…. Repeatable.",
        metavar="FIELD=VALUE",
    ),
    form: str = format_option(*TABLE_FORMATS),
    output: Path | None = output_option,
    random_seed: int = random_seed_option,
) -> None:  # fmt: skip
    """Compare two policies, prompts or rule sets on the same rollouts.

    A and B are result files or outcome tables, as for report tables: of two policies, of two
    prompts, or of the same episodes under two rule sets. Or A alone holds both sides, and --by
    names the column that separates them (for rule sets, rules).

    Rollouts are paired by task, seed, rollout, and whatever else is not compared. For SR, SSR, USR
    and VR, over all pairs and by stage and family, it reports the difference, its 95 % interval over
    tasks, and McNemar's exact p with Holm's adjustment. Where the sample is too small to show a
    difference, a warning says how many rollouts would be enough.

    \b
    Examples:
      safestage compare pi05.parquet groot.parquet
      safestage compare rows.parquet --by prompt --where policy=pi05
      safestage compare rows.parquet --by policy --between pi05 groot
      safestage compare old_rules.jsonl new_rules.jsonl
      safestage compare outcomes.csv --by policy -f json
    """
    if len(results) > 2:
        raise click.UsageError("give A and B, or one file with --by")
    from safestage_eval.metrics import read_outcomes
    from safestage_eval.metrics.comparison import compare, differs
    from safestage_eval.report.paired_report import render, warnings

    if len(results) == 2:
        if between:
            raise click.UsageError("--between chooses from one file; A and B are the sides")
        a, b = (_chosen(read_outcomes([file])[""], where) for file in results)
        by = by or differs(a, b)
        names: tuple[str, ...] = (
            results if by == "rules" else (getattr(a[0], by), getattr(b[0], by))
        )
        if names[0] == names[1] and by != "rules":
            raise click.UsageError(f"--by {by}: both sides are {names[0]!r}")
    else:
        if by is None:
            raise click.UsageError(
                "one file: say with --by policy, prompt or rules what tells its sides apart"
            )
        sides = _sides(results[0], by)
        names = between or tuple(sorted(sides))
        there = ", ".join(sorted(sides))
        if missing := [name for name in names if name not in sides]:
            raise click.UsageError(f"--between: no {by} {missing[0]!r}; there are {there}")
        if len(names) != 2 or names[0] == names[1]:
            raise click.UsageError(f"--by {by}: name two with --between; there are {there}")
        a, b = (_chosen(sides[name], where) for name in names)
    result = compare(a, b, by, (names[0], names[1]), seed=random_seed)
    written(render(result, form), output)
    for line in warnings(result):
        say(f"warning: {line}", err=True)


def _sides(file: str, by: By) -> Sides:
    """The outcomes of one file, by what tells its sides apart."""
    from safestage_eval.metrics import read_outcomes

    if by == "rules":
        return read_outcomes([file], "rules")
    sides: Sides = {}
    for outcome in read_outcomes([file])[""]:
        sides.setdefault(getattr(outcome, by), []).append(outcome)
    return sides


def _chosen(outcomes: list[Outcome], where: tuple[str, ...]) -> list[Outcome]:
    wanted = pairs(where, "--where", FIELDS)
    result = [o for o in outcomes if all(str(getattr(o, n)) == v for n, v in wanted.items())]
    if not result:
        raise click.UsageError(
            f"none of {len(outcomes)} outcomes is {' and '.join(where) or 'left'}"
        )
    return result
