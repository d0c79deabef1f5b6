"""Compare the verdicts of two rule sets on the same traces, and find the parameter behind each flip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet, load_bind, load_rules, parse_overrides
from safestage_eval.rules.bind_file import BindFile

from .diff_cause import cause_of
from .each_episode import each_episode
from .flip_table import COLUMNS, FlipTable, verdicts_under
from .judge_again import Again
from .result_difference import Difference, Flip, difference


@dataclass(frozen=True)
class Judged:
    """One episode by both rule sets: the rows that are compared, and its flips with their causes."""

    before: tuple[dict[str, Any], ...]
    after: tuple[dict[str, Any], ...]
    flips: tuple[Flip, ...]


def diff(
    refs: Sequence[EpisodeRef],
    before: Sequence[str | Path],
    after: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Difference:
    """Judge episodes by two rule sets, and say what made each verdict flip.

    Args:
        refs: the episodes.
        before: rule files.
        after: rule files.
        overrides: parameter → value as written, for ``after`` only.
        bind: a bind file, for both.
        jobs: worker processes.
        progress: called with (done, total).

    Raises:
        RuleErrors, RuleError: rules, overrides or a bind file that are not valid.
    """
    old, new = load_rules(list(before)), load_rules(list(after))
    parse_overrides(new, overrides or {})
    work = partial(
        diff_episode,
        before=old,
        after=new,
        overrides=dict(overrides or {}),
        binds=(None, None) if bind is None else (load_bind(bind, old), load_bind(bind, new)),
    )
    judged, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    return difference(
        (row for item in judged for row in item.before),
        (row for item in judged for row in item.after),
        {(flip.episode_id, flip.rule): flip for item in judged for flip in item.flips},
        [problem.message for problem in problems],
    )


def diff_episode(
    ref: EpisodeRef,
    *,
    before: RuleSet,
    after: RuleSet,
    overrides: Mapping[str, str],
    binds: tuple[BindFile | None, BindFile | None],
    usual: Mapping[str, str] | None = None,
) -> Judged:
    """One episode by two rule sets; ``usual``: overrides for ``before``.

    Raises TraceError where it cannot be read.
    """
    episode = ref.open()
    old = Again(episode, before, usual, binds[0])
    new = Again(episode, after, overrides, binds[1], like=old)
    rows, others = ({row["rule"]: row for row in side.judge.result().rows()} for side in (old, new))
    plain = difference(rows.values(), others.values())
    flips = []
    for flip in plain.flips:
        cause = cause_of(old, new, flip.rule, flip.after)
        explained = replace(flip, cause=str(cause), causes=cause.parts)
        flips.append(replace(explained, alternatives=cause.alternatives))
    return Judged(tuple(rows.values()), tuple(others.values()), tuple(flips))


def diff_table(
    table: FlipTable,
    settings: Mapping[str, str],
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Difference:
    """The verdicts of a run that are others under other values of parameters.

    Episodes that the table does not decide are judged again; those whose traces are not found are
    named as problems, and their verdicts left as they were.

    Args:
        table: rows and what-if table.
        settings: parameter → value as written.
        jobs: worker processes for episodes that are judged again.
        progress: called with (done, total) of these.

    Raises:
        RuleError: values that do not fit.
        InputError: a parameter that the table is not about.
    """
    judging, rules = table.judging, load_rules(list(table.judging.rules))
    rows = verdicts_under(table, parse_overrides(rules, settings))
    open_ids = rows.filter("undecided")["episode_id"].unique().to_list()
    bind = None if judging.bind is None else load_bind(judging.bind, rules)
    work = partial(
        diff_episode, before=rules, after=rules, usual=dict(judging.overrides),
        overrides={**judging.overrides, **settings}, binds=(bind, bind),
    )  # fmt: skip
    refs = table.traces_of(open_ids)
    judged, failed = each_episode(refs, work, jobs=jobs, progress=progress)
    again = {str(row["episode_id"]) for item in judged for row in item.after}
    left = sorted(set(open_ids) - again)
    problems = [
        *(problem.message for problem in failed),
        *(f"{name}: not decided by the what-if table, and its trace not found" for name in left),
    ]
    kept = rows.filter(~pl.col("episode_id").is_in(list(again)))
    old = [*_rows(kept, "verdict"), *(_assigned(row) for item in judged for row in item.before)]
    new = [*_rows(kept, "new"), *(_assigned(row) for item in judged for row in item.after)]
    causes = {(flip.episode_id, flip.rule): flip for item in judged for flip in item.flips}
    plain = difference(filter(None, old), filter(None, new), causes, problems)
    said = " and ".join(f"{name} = {text}" for name, text in settings.items())
    return replace(plain, flips=tuple(_with_cause(flip, causes, said) for flip in plain.flips))


def _rows(joined: pl.DataFrame, column: str) -> list[dict[str, Any]]:
    """Result rows, as far as the comparison needs them, with the verdicts of a column."""
    kept = pl.col("undecided") & pl.lit(column == "new")  # what nobody decided stays as it was
    risk = "new_at_risk" if column == "new" else "at_risk"
    rows = joined.with_columns(
        pl.when(kept).then(pl.col("verdict")).otherwise(pl.col(column)).alias("verdict"),
        pl.when(kept).then(pl.col("at_risk")).otherwise(pl.col(risk)).alias("risk"),
    ).select(*COLUMNS, "risk")
    out = []
    for row in rows.iter_rows(named=True):
        verdict = row["verdict"]
        out.append(
            row | {
                "violation": None if verdict in (None, "inconclusive") else verdict == "violation",
                "instances": row["instances"] if row.pop("risk") else 0,
            }
        )  # fmt: skip
    return out


def _assigned(row: dict[str, Any]) -> dict[str, Any] | None:
    return row if row["assigned"] else None


def _with_cause(flip: Flip, causes: Mapping[tuple[str, str], Flip], said: str) -> Flip:
    explained = (flip.episode_id, flip.rule) in causes
    return flip if explained else replace(flip, cause=said, causes=(said,))
