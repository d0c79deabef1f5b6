"""``safestage compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from safestage_eval.report import TABLE_FORMATS

from .shared_options import (
    bootstrap_seed_option,
    format_option,
    output_option,
    pairs,
    written,
)
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.metrics import Outcome
    from safestage_eval.metrics.paired import By

    Sides = tuple[list[Outcome], list[Outcome], tuple[str, str], By]

FIELDS = ("task", "stage", "family", "policy", "prompt", "seed", "rollout")


@click.command("compare")
@click.argument("results", nargs=-1, required=True, metavar="A [B]")
@click.option(
    "--by", type=click.Choice(["policy", "prompt", "rules"]),
    help="Compare two policies, prompts or rule sets of one file. With two files, the default is one side per file.",
)  # fmt: skip
@click.option(
    "--between", nargs=2, metavar="FIRST SECOND",
    help="Compare these two policies, prompts or rule sets, where a file has more.",
)  # fmt: skip
@click.option(
    "--where", multiple=True, metavar="FIELD=VALUE",
    help="Select outcomes: policy=…, prompt=…, stage=…, task=…, seed=…. Repeatable.",
)  # fmt: skip
@format_option(*TABLE_FORMATS)
@output_option
@bootstrap_seed_option
def command(
    results: tuple[str, ...],
    by: By | None,
    between: tuple[str, str] | None,
    where: tuple[str, ...],
    form: str,
    output: Path | None,
    random_seed: int,
) -> None:
    """Compare two policies, prompts or rule sets on the same rollouts.

    A and B are result files or outcome tables, as for aggregate: of two policies, of two prompts,
    or of the same episodes under two rule sets. Or A alone holds both sides, and --by names the
    column that separates them (for rule sets, rules).

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
    a, b, names, differing = (
        _two_files(results, by, between, where)
        if len(results) == 2
        else _one_file(results[0], by, between, where)
    )
    from safestage_eval.metrics.comparison import compare
    from safestage_eval.report.paired_report import render, warnings

    result = compare(a, b, differing, names, seed=random_seed)
    written(render(result, form), output)
    for line in warnings(result):
        say(f"warning: {line}", err=True)


def _two_files(
    files: tuple[str, ...],
    by: By | None,
    between: tuple[str, str] | None,
    where: tuple[str, ...],
) -> Sides:
    if between:
        raise click.UsageError("--between chooses from one file; A and B are the sides")
    from safestage_eval.metrics import read_outcomes
    from safestage_eval.metrics.comparison import differs

    a, b = (_chosen(read_outcomes([file])[""], where) for file in files)
    differing = by or differs(a, b)
    if differing == "rules":
        names = files[0], files[1]
    else:
        names = getattr(a[0], differing), getattr(b[0], differing)
        if names[0] == names[1]:
            raise click.UsageError(f"--by {differing}: both sides are {names[0]!r}")
    return a, b, names, differing


def _one_file(
    file: str, by: By | None, between: tuple[str, str] | None, where: tuple[str, ...]
) -> Sides:
    if by is None:
        raise click.UsageError(
            "one file: say with --by policy, prompt or rules what tells its sides apart"
        )
    from safestage_eval.metrics import read_outcomes

    if by == "rules":
        groups = read_outcomes([file], "rules")
    else:
        groups = {}
        for outcome in read_outcomes([file])[""]:
            groups.setdefault(getattr(outcome, by), []).append(outcome)
    names = sorted(groups) if between is None else list(between)
    for name in names:
        if name not in groups:
            raise click.UsageError(f"--between: no {by} {name!r}; there are {', '.join(groups)}")
    if len(names) != 2 or names[0] == names[1]:
        all_names = ", ".join(sorted(groups))
        raise click.UsageError(f"--by {by}: name two with --between; there are {all_names}")
    return (
        _chosen(groups[names[0]], where),
        _chosen(groups[names[1]], where),
        (names[0], names[1]),
        by,
    )


def _chosen(outcomes: list[Outcome], where: tuple[str, ...]) -> list[Outcome]:
    wanted = pairs(where, "--where", FIELDS)
    result = [o for o in outcomes if all(str(getattr(o, n)) == v for n, v in wanted.items())]
    if not result:
        raise click.UsageError(
            f"none of {len(outcomes)} outcomes is {' and '.join(where) or 'left'}"
        )
    return result
