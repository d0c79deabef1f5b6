"""The rates of episodes under every value of a parameter, from one pass over the traces."""

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
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics import METRICS, Outcome, Rates, rates
from safestage_eval.rules import load_bind, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.problem import Problem

from .each_episode import each_episode
from .sweep_segments import FIELDS, KEYS, NO, OPEN, UNKNOWN, YES, segment_frame, sweep_episode
from .swept_values import si_unit

COUNTS = ("success", "engagement", "risk", "code", "missing")
"""Columns of a segment that determine what it counts as."""
I64 = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Sweep:
    """The rates of episodes under every value of a parameter.

    Attributes:
        param: its name.
        values: in rising order.
        default: the value of ``[param]``.
        readers: codes of the rules that read it and judged an episode.
        unread: how many episodes have no assigned rule that reads it.
        problems: episodes that could not be judged.
        segments: rows as in ``SEGMENTS``.
        again: how many episodes were judged again because the what-if table does not decide them.
        undecided: how many episodes neither the table nor judging decides; they count as inconclusive.
    """

    param: str
    values: tuple[ast.Setting, ...]
    default: ast.Setting
    readers: tuple[str, ...]
    unread: int
    problems: tuple[Problem, ...]
    segments: pl.DataFrame
    again: int = 0
    undecided: int = 0

    @property
    def count(self) -> int:
        """How many episodes are counted."""
        return int(self.segments["episode_id"].n_unique())

    @property
    def remarks(self) -> list[str]:
        """Sentences on the episodes that the what-if table does not decide."""
        said = []
        if self.again:
            said.append(f"{self.again} of these not decided by the what-if table: judged again.")
        if self.undecided:
            said.append(
                f"{self.undecided} of these not decided by the what-if table, and their traces not "
                "found: inconclusive under the values that it leaves open."
            )
        return said

    def curves(self, by: Sequence[str] = ()) -> dict[tuple[str, ...], list[Rates]]:
        """Group → the rates under every value; without ``by`` the one group ``()``."""
        if "rule" in by:  # a rule is judged whether or not others are loaded
            segments = self.segments.with_columns(missing=pl.lit(value=False))
        else:
            segments = _by_episode(self.segments)
        counted = segments.group_by(*by, *COUNTS, "first", "stop").len()
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
        return {
            key: [_rates(vector) for vector in groups[key].cumsum(axis=0)[:-1]]
            for key in sorted(groups)
        }

    def flips(self) -> list[dict[str, Any]]:
        """The pairs of neighbouring values between which a verdict changes, by episode and rule."""
        changed = (
            self.segments.sort(*KEYS, "first")
            .with_columns(pl.col("verdict").shift(1).over(KEYS).alias("from"))
            .filter(pl.col("from") != pl.col("verdict"))
        )
        numbers = [amount(value) for value in self.values]
        return [
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

    def rows(self, by: Sequence[str] = ()) -> list[dict[str, Any]]:
        """One flat row per group and value: rates 0…1, their counts, those not in N, and at risk."""
        return [
            {
                **dict(zip(by, key, strict=True)),
                "param": self.param,
                "value": amount(value),
                "unit": si_unit(value),
                **{metric: cell.value(metric) for metric in METRICS},
                **{f"{metric}_k": cell.counts[metric] for metric in METRICS},
                "n": cell.n,
                "inconclusive": cell.inconclusive,
                "not_judged": cell.not_judged,
                "at_risk": cell.given["at risk"]["N"],
                **{f"{metric}_at_risk": cell.value(metric, "at risk") for metric in METRICS},
            }
            for key, cells in self.curves(by).items()
            for value, cell in zip(self.values, cells, strict=True)
        ]


def sweep(
    refs: Sequence[EpisodeRef],
    specs: Sequence[str | Path],
    param: str,
    values: Sequence[ast.Setting],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | BindFile | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Judge episodes under every value of a parameter; of several with one id the first counts.

    Args:
        refs: the episodes.
        specs: rule files.
        param: the parameter; its values here beat every other source.
        values: in SI, of the parameter's dimension.
        overrides: other parameters, as written.
        bind: a bind file, or what was read of one.
        jobs: worker processes.
        progress: called with (done, total).

    Raises:
        InputError: no loaded rule reads the parameter, or no episode's assigned rule does.
    """
    rules = load_rules(list(specs))
    read = {code: parameters_read(rules, rule) for code, rule in rules.scoped.items()}
    readers = [code for code, params in read.items() if param in params]
    if not readers:
        allowed = ", ".join(sorted(frozenset().union(*read.values())))
        raise InputError(
            f"--param {param}", "no loaded rule reads it.", allowed or "rules that read a parameter"
        )
    rising = tuple(sorted(values, key=amount))
    work = partial(
        sweep_episode,
        rules=rules,
        param=param,
        values=rising,
        overrides=dict(overrides or {}),
        bind=load_bind(bind, rules) if isinstance(bind, str | Path) else bind,
    )
    swept, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    judged = dict(reversed(swept))
    rows = [row for segments in reversed(judged.values()) for row in segments]
    if not rows and not problems:
        raise InputError(
            f"--param {param}",
            f"read by {', '.join(readers)}, which no episode is judged by.",
            fix="take traces whose headers assign one of them, or assign it with --bind",
        )
    segments = segment_frame(rows)
    used = set(segments["rule"])
    return Sweep(
        param,
        rising,
        rules.params[param],
        tuple(code for code in readers if code in used),
        sum(not one for one in judged.values()),
        tuple(problems),
        segments,
    )


def _by_episode(segments: pl.DataFrame) -> pl.DataFrame:
    """Segments of episodes: all their assigned rules together."""
    rules = segments.group_by("episode_id").agg(pl.col("rule").n_unique().alias("rules"))
    counted = segments.join(rules, on="episode_id")
    one, several = counted.filter(pl.col("rules") == 1), counted.filter(pl.col("rules") > 1)
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
    """An episode of a kind; arguments as in ``COUNTS``."""
    violation = {NO: False, UNKNOWN: None, YES: True}[code]
    return Outcome(
        OPEN, OPEN, OPEN, success,
        None if missing and not violation else violation,
        judged=not missing or violation is True,
        at_risk=risk,
        engagement=engagement,
    )  # fmt: skip


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
