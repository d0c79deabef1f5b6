"""Two sets of results side by side: which verdicts flipped, and how the rates moved.

Result files are those that ``safestage score`` writes: JSON, JSON lines, CSV or Parquet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safestage_eval.metrics import METRICS, by_policy_stage, outcomes_of
from safestage_eval.metrics.read_rows import demand_columns, read_rows

Row = Mapping[str, Any]
"""A result row (docs/results.md); only the columns that are used must be there."""

NEEDED = ("episode_id", "rule", "assigned", "verdict", "success")
"""Columns without which results cannot be compared."""

ALLOWED = "a file that safestage score wrote with --format json, jsonl, csv or parquet"


@dataclass(frozen=True)
class Flip:
    """One verdict that is another than it was.

    Attributes:
        episode_id, rule: whose.
        assigned: the rule is the task's own.
        before, after: verdicts.
        signal: what was decisive afterwards.
        margins: before and after; None where a verdict has none.
        units: of the two margins.
        cause: what made it flip, as short as it can be said.
        causes: the smallest set of differences that flips it, where rules were compared.
        alternatives: how many other sets of that size would flip it too.
    """

    episode_id: str
    rule: str
    assigned: bool
    before: str
    after: str
    signal: str | None = None
    margins: tuple[float | None, float | None] = (None, None)
    units: tuple[str | None, str | None] = (None, None)
    cause: str = ""
    causes: tuple[str, ...] = ()
    alternatives: int = 0


@dataclass(frozen=True)
class RateChange:
    """One rate of one cell that moved; values 0…1, None where N is 0."""

    policy: str
    prompt: str
    stage: str
    metric: str
    before: float | None
    after: float | None
    counts: tuple[tuple[int, int], tuple[int, int]]
    """(k, N) before and after."""


@dataclass(frozen=True)
class Difference:
    """All that differs between two sets of results.

    Attributes:
        flips: by rule, then episode.
        rates: those that moved.
        same: verdicts that are what they were.
        only_before, only_after: (episode, rule) pairs that the other set lacks.
        problems: messages about what could not be judged.
    """

    flips: tuple[Flip, ...]
    rates: tuple[RateChange, ...]
    same: int
    only_before: tuple[tuple[str, str], ...]
    only_after: tuple[tuple[str, str], ...]
    problems: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """Nothing flipped, and nothing is missing on either side."""
        return not (self.flips or self.only_before or self.only_after)

    def by_rule(self) -> dict[str, list[Flip]]:
        """Code → its flips."""
        flips: dict[str, list[Flip]] = {}
        for flip in self.flips:
            flips.setdefault(flip.rule, []).append(flip)
        return flips


def read_results(path: str | Path) -> list[dict[str, Any]]:
    """The rows of a result file; its format is found from its content.

    Raises InputError for a file that cannot be read or lacks a column that is needed.
    """
    rows = read_rows(path, allowed=ALLOWED)
    for number, row in enumerate(rows, 1):
        demand_columns(row, NEEDED, f"{path}, row {number}", ALLOWED)
    return rows


def difference(
    before: Iterable[Row],
    after: Iterable[Row],
    causes: Mapping[tuple[str, str], Flip] | None = None,
    problems: Sequence[str] = (),
) -> Difference:
    """Compare two sets of result rows.

    Args:
        before: rows, one per episode and rule; of several of one pair the first counts.
        after: the same.
        causes: (episode, rule) → the flip with its cause, where that was searched for.
        problems: to be passed on.
    """
    old, new = _keyed(before), _keyed(after)
    flips = [
        (causes or {}).get(key) or _flip(old[key], new[key])
        for key in sorted(old.keys() & new.keys(), key=lambda key: key[::-1])
        if old[key]["verdict"] != new[key]["verdict"]
    ]
    return Difference(
        tuple(flips),
        tuple(_rates(list(old.values()), list(new.values()))),
        len(old.keys() & new.keys()) - len(flips),
        tuple(sorted(old.keys() - new.keys())),
        tuple(sorted(new.keys() - old.keys())),
        tuple(problems),
    )


def _keyed(rows: Iterable[Row]) -> dict[tuple[str, str], Row]:
    by_key: dict[tuple[str, str], Row] = {}
    for row in rows:
        if row["verdict"] is None:
            continue  # a cost without a budget
        by_key.setdefault((str(row["episode_id"]), str(row["rule"])), row)
    return by_key


def _flip(old: Row, new: Row) -> Flip:
    return Flip(
        str(new["episode_id"]),
        str(new["rule"]),
        bool(new["assigned"]),
        str(old["verdict"]),
        str(new["verdict"]),
        new.get("signal"),
        (old.get("margin"), new.get("margin")),
        (old.get("unit"), new.get("unit")),
        _why(old, new),
    )


def _why(old: Row, new: Row) -> str:
    """Whose doing it is, as far as hashes and digests tell."""

    def differs(name: str) -> bool:
        return bool(old.get(name) and new.get(name) and old[name] != new[name])

    reasons = [
        reason
        for reason, is_so in (
            ("another trace", differs("trace_hash")),
            ("rule or parameter changed", differs("rule_digest")),
        )
        if is_so
    ]
    if reasons:
        return " and ".join(reasons)
    comparable = all(row.get(name) for row in (old, new) for name in ("trace_hash", "rule_digest"))
    return "same trace, same rule: the evaluator has changed" if comparable else "not known"


def _rates(old: Sequence[Row], new: Sequence[Row]) -> Iterable[RateChange]:
    before, after = (by_policy_stage(outcomes_of(rows)) for rows in (old, new))
    for key in (key for key in before if key in after):
        a, b = before[key], after[key]
        for metric in METRICS:
            counts = ((a.counts[metric], a.n), (b.counts[metric], b.n))
            if counts[0] != counts[1]:
                policy, prompt, stage = key
                yield RateChange(
                    policy, prompt, stage, metric, a.value(metric), b.value(metric), counts
                )
