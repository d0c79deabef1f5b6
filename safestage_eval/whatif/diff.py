"""Compare the verdicts of two rule sets on the same traces, and find the parameter behind each flip."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

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
        causes, more = cause_of(old, new, flip.rule, flip.after)
        said = " and ".join(causes) + (f" (so would {more} other)" if more else "")
        flips.append(replace(flip, cause=said, causes=causes, alternatives=more))
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
    problems = [problem.message for problem in failed]
    problems += [
        f"{name}: not decided by the what-if table, and its trace not found"
        for name in sorted(set(open_ids) - again)
    ]
    said = " and ".join(f"{name} = {text}" for name, text in settings.items())
    kept = rows.filter(~pl.col("episode_id").is_in(list(again)))
    flips = {(flip.episode_id, flip.rule): flip for item in judged for flip in item.flips}
    plain = difference(
        [
            *_rows(kept, "verdict", "at_risk"),
            *(r for i in judged for r in i.before if r["assigned"]),
        ],
        [
            *_rows(kept, "new", "new_at_risk"),
            *(r for i in judged for r in i.after if r["assigned"]),
        ],
        flips,
        problems,
    )
    return replace(
        plain,
        flips=tuple(
            flip
            if (flip.episode_id, flip.rule) in flips
            else replace(flip, cause=said, causes=(said,))
            for flip in plain.flips
        ),
    )


def _rows(joined: pl.DataFrame, verdict: str, at_risk: str) -> Iterator[dict[str, Any]]:
    """Result rows, as far as the comparison needs them; what nobody decided stays as it was."""
    for row in joined.iter_rows(named=True):
        found = row["verdict" if row["undecided"] else verdict]
        there = row["at_risk" if row["undecided"] else at_risk]
        yield {name: row[name] for name in COLUMNS} | {
            "verdict": found,
            "violation": None if found in (None, "inconclusive") else found == "violation",
            "instances": row["instances"] if there else 0,
        }


# ---- what made a verdict flip

TOGETHER = 2
"""So many differences are tried together, in all combinations."""


def cause_of(before: Again, after: Again, code: str, wanted: str) -> tuple[tuple[str, ...], int]:
    """A smallest set of differences that takes a rule's verdict from the one to the other.

    Each is tried alone, then with one other; where no two suffice, all that cannot be left out are named.

    Args:
        before: one episode under one rule set.
        after: the same under the other.
        code: of a rule that both have.
        wanted: the verdict afterwards.

    Returns the differences in words, and how many other sets of as many would flip it as well.
    """
    old, new = (_meaning(side, code) for side in (before, after))
    parts: list[Part | str] = [*differences(old, new)]
    if _players(before, code) != _players(after, code):
        parts.append(PLAYERS)
    if before.judge.success_time != after.judge.success_time:
        parts.append(SUCCESS)

    def flips(chosen: Sequence[Part | str]) -> bool:
        return _verdict(before, after, code, chosen) == wanted

    for size in range(1, TOGETHER + 1):
        hits = [chosen for chosen in itertools.combinations(parts, size) if flips(chosen)]
        if hits:
            return tuple(map(str, hits[0])), len(hits) - 1
    kept = list(parts)
    for part in parts:
        fewer = [other for other in kept if other is not part]
        if flips(fewer):
            kept = fewer
    return tuple(map(str, kept)), 0


PLAYERS, SUCCESS = "who plays the roles", "when the goal counts as reached"


def _meaning(side: Again, code: str) -> Meaning:
    rule = side.rules.scoped[code]
    return Meaning(side.rules, rule, side.binding.params(rule))


def _players(side: Again, code: str) -> Mapping[str, Sequence[str]]:
    return side.players(side.rules.scoped[code])


def _verdict(before: Again, after: Again, code: str, chosen: Sequence[Part | str]) -> str | None:
    """The verdict of a rule on an episode with the chosen differences; None where the rule has no sense."""
    parts = [part for part in chosen if isinstance(part, Part)]
    meaning = mixed(_meaning(before, code), _meaning(after, code), parts)
    rule = meaning.rule
    roles = {name for name, _ in rule.roles}
    if any(set(call.args) - roles - GROUPS.keys() for call in calls(rule)):
        return None  # an obligation of the one rule with the roles of the other
    if isinstance(rule, ast.Rule) and not rule.clauses:
        return None  # it asks for nothing
    sides = (after, before) if PLAYERS in chosen else (before, after)
    bodies = {**_players(sides[1], code), **_players(sides[0], code)}
    players = {name: bodies.get(name, ()) for name in roles}
    timed = after if SUCCESS in chosen else before
    return timed.mixed((before, after), meaning.rules, rule, meaning.params, players).verdict
