"""Compare the verdicts of two rule sets on the same traces, and find the parameter behind each flip."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import polars as pl

from safestage_eval.formats import EpisodeRef
from safestage_eval.relations.vocabulary import GROUPS
from safestage_eval.rules import RuleSet, load_bind, load_rules, parse_overrides
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.compare import Meaning, Part, differences, mixed
from safestage_eval.rules.uses import calls

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


# ---- what made a verdict flip

P = TypeVar("P")

MOST = 400
"""Combinations tried per flip; beyond, a set is found by leaving things out."""


@dataclass(frozen=True)
class Cause:
    """A smallest set of differences that flips a verdict.

    Attributes:
        parts: in words; switching exactly these flips it.
        alternatives: other sets of this size that flip it as well; as many as were tried.
        untried: size of the smallest sets that were not all tried; None where no smaller set than
            this one flips it, and all others of its size were tried.
    """

    parts: tuple[str, ...]
    alternatives: int = 0
    untried: int | None = None

    def __str__(self) -> str:
        """The differences in words, and the sets that were not tried."""
        said = " and ".join(self.parts)
        if self.alternatives:
            said += f" (so would {self.alternatives} other)"
        if self.untried is None:
            return said
        if self.untried == len(self.parts):
            return f"{said} (none of fewer; others of {self.untried} were not all tried)"
        return f"{said} (none can be left out; sets of {self.untried} or more were not all tried)"


def cause_of(before: Again, after: Again, code: str, wanted: str) -> Cause:
    """The smallest set of differences that takes a rule's verdict from the one to the other.

    One difference is switched at a time, then pairs, and so on, up to ``MOST`` combinations.

    Args:
        before: one episode under one rule set.
        after: the same under the other.
        code: of a rule that both have.
        wanted: the verdict afterwards.
    """
    trial = _Trial(before, after, code)
    return smallest(trial.parts, lambda chosen: trial.verdict(chosen) == wanted)


def smallest(parts: Sequence[P], flips: Callable[[Sequence[P]], bool], most: int = MOST) -> Cause:
    """The smallest set of parts that flips a verdict, and how surely it is the smallest.

    Args:
        parts: all of them together flip it.
        flips: whether some do.
        most: sets that are tried one size after another.
    """
    tried = 0
    for size in range(1, len(parts) + 1):
        hits: list[Sequence[P]] = []
        for chosen in itertools.combinations(parts, size):
            if tried == most:
                chosen_set = hits[0] if hits else _shrunk(parts, flips)
                return Cause(_shown(chosen_set), max(0, len(hits) - 1), size)
            tried += 1
            if flips(chosen):
                hits.append(chosen)
        if hits:
            return Cause(_shown(hits[0]), len(hits) - 1)
    return Cause(_shown(parts))


def _shrunk(parts: Sequence[P], flips: Callable[[Sequence[P]], bool]) -> Sequence[P]:
    """All parts, without those that can be left out, until none can."""
    kept, before = list(parts), len(parts) + 1
    while len(kept) < before:
        before = len(kept)
        for part in list(kept):
            fewer = [other for other in kept if other is not part]
            if fewer and flips(fewer):
                kept = fewer
    return kept


def _shown(parts: Sequence[object]) -> tuple[str, ...]:
    return tuple(map(str, parts))


class _Trial:
    """One rule on one episode, with any of the differences switched."""

    def __init__(self, before: Again, after: Again, code: str) -> None:
        self._sides = (before, after)
        old, new = (side.rules.scoped[code] for side in self._sides)
        self._old = Meaning(before.rules, old, before.binding.params(old))
        self._new = Meaning(after.rules, new, after.binding.params(new))
        self._players = tuple(
            side.binding.players(rule, side.episode.header)
            for side, rule in zip(self._sides, (old, new), strict=True)
        )
        self.parts: list[Part | str] = [*differences(self._old, self._new)]
        if self._players[0] != self._players[1]:
            self.parts.append("who plays the roles")
        if before.judge.success_time != after.judge.success_time:
            self.parts.append("when the goal counts as reached")

    def verdict(self, chosen: Sequence[Part | str]) -> str:
        """The verdict with the chosen differences switched."""
        meaning = mixed(self._old, self._new, [p for p in chosen if isinstance(p, Part)])
        rule = meaning.rule
        roles = {name for name, _ in rule.roles}
        if any(set(call.args) - roles - GROUPS.keys() for call in calls(rule)):
            return "senseless"  # an obligation of the one rule with the roles of the other
        if isinstance(rule, ast.Rule) and not rule.clauses:
            return "senseless"  # it asks for nothing
        swapped = "who plays the roles" in chosen
        bodies = {**self._players[not swapped], **self._players[swapped]}
        timed = self._sides["when the goal counts as reached" in chosen]
        players = {name: bodies.get(name, ()) for name in roles}
        return timed.mixed(self._sides, meaning.rules, rule, meaning.params, players).verdict
