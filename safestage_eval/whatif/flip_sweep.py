"""A sweep over the rows of a run: every value of a parameter, answered from the what-if table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.metrics import Outcome, Rates, rates
from safestage_eval.rules import load_bind, load_rules
from safestage_eval.verdicts.problem import Problem

from .flip_query import KEYS, pieces_about, was_at_risk
from .flip_table import FlipTable
from .many import each_episode
from .sweep import Curves, Swept, outcome_of, sweep_episode
from .swept_values import amount

OPEN = "–"
FIELDS = ("policy", "prompt", "stage", "task")
"""Of an episode, that curves can be told apart by."""
COUNTS = ("success", "engagement", "risk", "code", "missing")
"""What an episode counts as."""
NO, UNKNOWN, YES = 0, 1, 2
"""Violated or not; of several rules the greatest counts."""
I64 = NDArray[np.int64]


@dataclass(frozen=True)
class TableSweep(Curves):
    """A sweep over the rows of a run.

    Attributes:
        segments: one row per episode, rule and run of values with one verdict: ``first`` and ``stop``
            of the values, ``code`` (``NO`` …), ``risk``, and what is known of the episode.
        again: episodes that the table does not decide under every value, judged again.
        undecided: how many of them could not be judged again; they count as inconclusive.
    """

    segments: pl.DataFrame
    again: tuple[Swept, ...]
    undecided: int

    @property
    def count(self) -> int:
        """Of the episodes that are counted."""
        return int(self.segments["episode_id"].n_unique()) + len(self.again)

    @property
    def remarks(self) -> list[str]:
        """How many episodes the table does not decide."""
        said = []
        if self.again:
            said.append(
                f"{len(self.again)} of these not decided by the what-if table: judged again."
            )
        if self.undecided:
            said.append(
                f"{self.undecided} of these not decided by the what-if table, and their traces not "
                "found: inconclusive under the values that it leaves open."
            )
        return said

    def curves(self, by: Sequence[str] = ()) -> dict[tuple[str, ...], list[Rates]]:
        """Group → the rates under every value; one group ``()`` if nothing is told apart."""
        by_rule = "rule" in by
        found = self.segments if by_rule else _by_episode(self.segments)
        if by_rule:
            found = found.with_columns(missing=pl.lit(value=False))
        counted = found.group_by(*by, *COUNTS, "first", "stop").len()
        groups: dict[tuple[str, ...], I64] = {}
        vectors: dict[tuple[Any, ...], I64] = {}
        for row in counted.iter_rows(named=True):
            key = tuple(row[name] for name in by)
            if key not in groups:
                groups[key] = np.zeros((len(self.values) + 1, len(_NOTHING)), np.int64)
            kind = tuple(row[name] for name in COUNTS)
            if kind not in vectors:
                vectors[kind] = _vector(rates((_outcome(*kind),)))
            vector = row["len"] * vectors[kind]
            groups[key][row["first"]] += vector
            groups[key][row["stop"]] -= vector
        for episode in self.again:
            for rule in (episode.moved or {}) if by_rule else (None,):
                names = {"rule": rule}
                key = tuple(str(names.get(n) or getattr(episode, n, OPEN)) for n in by)
                many = groups.setdefault(
                    key, np.zeros((len(self.values) + 1, len(_NOTHING)), np.int64)
                )
                for i in range(len(self.values)):
                    vector = _vector(rates((outcome_of(episode, i, rule),)))
                    many[i] += vector
                    many[i + 1] -= vector
        return {
            key: [_rates(vector) for vector in groups[key].cumsum(axis=0)[:-1]]
            for key in sorted(groups)
        }

    def flips(self) -> list[dict[str, Any]]:
        """Between which two values each verdict changes."""
        ordered = self.segments.sort(*KEYS, "first").with_columns(
            pl.col("verdict").shift(1).over(KEYS).alias("from"),
        )
        changed = ordered.filter(
            pl.col("from").is_not_null()
            & pl.col("verdict").is_not_null()
            & (pl.col("from") != pl.col("verdict"))
        )
        numbers = [amount(value) for value in self.values]
        out = [
            {
                "episode_id": row["episode_id"],
                "rule": row["rule"],
                "below": numbers[row["first"] - 1],
                "above": numbers[row["first"]],
                "from": row["from"],
                "to": row["verdict"],
            }
            for row in changed.iter_rows(named=True)
        ]
        for episode in self.again:
            for code, names in (episode.moved or {}).items():
                out += [
                    {
                        "episode_id": episode.episode_id, "rule": code,
                        "below": numbers[i], "above": numbers[i + 1],
                        "from": names[i], "to": names[i + 1],
                    }
                    for i in range(len(names) - 1)
                    if names[i] != names[i + 1]
                ]  # fmt: skip
        return out


def sweep_table(
    table: FlipTable,
    param: str,
    values: Sequence[Any],
    *,
    judge_again: bool = True,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TableSweep:
    """The rates of a run under every value of a parameter.

    Args:
        table: rows and what-if table.
        param: the parameter.
        values: in SI, of the parameter's dimension.
        judge_again: open the traces of episodes that the table does not decide.
        jobs: worker processes for these.
        progress: told (done, total) of these.

    Raises InputError for a parameter that the table is not about.
    """
    rules = load_rules(list(table.judging.rules))
    rising = tuple(sorted(values, key=amount))
    pieces = pieces_about(table, param, rising)
    segments = _segments(table, pieces, np.array([amount(value) for value in rising]))
    open_ids = segments.filter(pl.col("verdict").is_null())["episode_id"].unique().to_list()
    again: list[Swept] = []
    problems: list[Problem] = []
    if open_ids and judge_again:
        judged, problems = _again(table, open_ids, param, rising, jobs, progress)
        again = [item for item in judged if not item.unread]
        done = [item.episode_id for item in judged]
        segments = segments.filter(~pl.col("episode_id").is_in(done))
    left = segments.filter(pl.col("verdict").is_null())["episode_id"].n_unique()
    return TableSweep(
        param,
        rising,
        rules.params[param],
        tuple(sorted(pieces["rule"].unique().to_list())),
        table.rows["episode_id"].n_unique() - pieces["episode_id"].n_unique(),
        tuple(problems),
        segments,
        tuple(again),
        int(left),
    )


def _segments(table: FlipTable, pieces: pl.DataFrame, values: NDArray[np.float64]) -> pl.DataFrame:
    """Which of the rising values each piece holds, with what is known of its episode."""
    first = np.searchsorted(values, pieces["low"].to_numpy())
    stop = np.searchsorted(values, pieces["high"].to_numpy())
    lowest = pieces["low"].to_numpy() == 0  # values below 0, which nothing decides, count to it
    first = np.where(lowest, 0, first)
    asked = pieces.select(*KEYS, "verdict", pl.col("at_risk").alias("risk")).with_columns(
        pl.Series("first", first), pl.Series("stop", stop), code_of("verdict")
    )
    reading = pieces.select(KEYS).unique().with_columns(pl.lit(value=True).alias("reads"))
    rows = table.rows.with_columns(was_at_risk(), code_of("verdict"))
    rows = rows.join(reading, on=KEYS, how="left").with_columns(
        pl.col("reads").fill_null(value=False),
        (pl.col("vacuity") == "not_loaded").fill_null(value=False).alias("absent"),
    )
    rest = ~pl.col("reads") & ~pl.col("absent")
    episodes = rows.group_by("episode_id").agg(
        *(pl.col(name).first().fill_null(OPEN) for name in FIELDS),
        pl.col("success").first(),
        pl.col("engagement").first(),
        pl.col("absent").any().alias("missing"),
        pl.col("code").filter(rest).max().fill_null(NO).alias("rest"),
        pl.col("at_risk").filter(rest).any().alias("rest_at_risk"),
    )
    return asked.filter(pl.col("first") < pl.col("stop")).join(episodes, on="episode_id")


def code_of(column: str) -> pl.Expr:
    """``NO``, ``UNKNOWN`` or ``YES`` of a verdict; undecided ones are unknown."""
    verdict = pl.col(column).cast(pl.String)
    return (
        pl.when(verdict == "violation").then(YES)
        .when(verdict.is_in(["pass", "not_applicable"])).then(NO)
        .otherwise(UNKNOWN).cast(pl.Int8).alias("code")
    )  # fmt: skip


def _by_episode(segments: pl.DataFrame) -> pl.DataFrame:
    """The segments of episodes: all their assigned rules together."""
    rules = segments.group_by("episode_id").agg(pl.col("rule").n_unique().alias("rules"))
    found = segments.join(rules, on="episode_id")
    one, several = found.filter(pl.col("rules") == 1), found.filter(pl.col("rules") > 1)
    if len(several):  # value by value
        each = several.with_columns(pl.int_ranges("first", "stop").alias("first")).explode("first")
        facts = [*FIELDS, "success", "engagement", "missing", "rest", "rest_at_risk"]
        each = each.group_by("episode_id", "first").agg(
            *(pl.col(name).first() for name in facts), pl.col("code").max(), pl.col("risk").any()
        )
        each = each.with_columns((pl.col("first") + 1).alias("stop"))
        one = pl.concat([one.select(each.columns), each], how="vertical_relaxed")
    return one.with_columns(
        pl.max_horizontal("code", "rest").alias("code"),
        (pl.col("risk") | pl.col("rest_at_risk")).alias("risk"),
    )


def _outcome(
    success: bool | None, engagement: str | None, risk: bool, code: int, missing: bool
) -> Outcome:
    """An episode of a kind; ``COUNTS``."""
    violation = {NO: False, UNKNOWN: None, YES: True}[code]
    return Outcome(
        OPEN, OPEN, OPEN, success,
        None if missing and not violation else violation,
        judged=not missing or violation is True,
        at_risk=risk,
        engagement=engagement,
    )  # fmt: skip


def _again(
    table: FlipTable,
    ids: Sequence[str],
    param: str,
    values: Sequence[Any],
    jobs: int | None,
    progress: Callable[[int, int], None] | None,
) -> tuple[list[Swept], list[Problem]]:
    """Episodes under every value, judged from their traces as the table was; and what went wrong."""
    rules, told = load_rules(list(table.judging.rules)), table.judging
    work = partial(
        sweep_episode, rules=rules, param=param, values=tuple(values),
        overrides=dict(told.overrides),
        bind=None if told.bind is None else load_bind(told.bind, rules),
    )  # fmt: skip
    found = each_episode(traces_of(table, ids), work, jobs=jobs, progress=progress)
    return (
        [item for item in found if isinstance(item, Swept)],
        [item for item in found if isinstance(item, Problem)],
    )


def traces_of(table: FlipTable, ids: Sequence[str]) -> list[EpisodeRef]:
    """The traces of some episodes, as far as they are where they were judged."""
    wanted = table.rows.filter(pl.col("episode_id").is_in(list(ids)))["path"].unique()
    paths = [path for path in wanted.to_list() if path and Path(path).exists()]
    try:
        refs = discover(sorted(paths)) if paths else []
    except InputError:
        return []
    found = {ref.episode_id: ref for ref in refs}
    return [found[name] for name in ids if name in found]


# ---- rates as vectors, so that many are added at once


def _vector(cell: Rates) -> I64:
    plain = [cell.n, *cell.counts.values(), *cell.surely.values(), *cell.maybe.values()]
    plain += [cell.inconclusive, cell.not_judged]
    for given in cell.given.values():
        plain += given.values()
    return np.array([*plain, *cell.engagement.values()], np.int64)


def _rates(vector: I64) -> Rates:
    rest = iter(vector.tolist())

    def like(names: Mapping[Any, int]) -> dict[Any, int]:
        return {name: next(rest) for name in names}

    return Rates(
        n=next(rest),
        counts=like(_EMPTY.counts),
        surely=like(_EMPTY.surely),
        maybe=like(_EMPTY.maybe),
        inconclusive=next(rest),
        not_judged=next(rest),
        given={name: like(given) for name, given in _EMPTY.given.items()},
        engagement=like(_EMPTY.engagement),
    )


_EMPTY = rates(())
_NOTHING = _vector(_EMPTY)
