"""The rates of episodes under every value of a parameter, from traces or from the what-if table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import groupby
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics import METRICS, Outcome, Rates, rates
from safestage_eval.rules import RuleSet, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.problem import Problem

from .each_episode import Progress, each_episode
from .flip_table import COLUMNS, KEYS, FlipTable, pieces_about, was_at_risk
from .judge_again import Again, again_by
from .swept_values import si_unit, told_in
from .value_ranges import Piece, all_pieces

FEW = 4
"""Number of values up to which each is judged by itself."""

FIELDS = ("policy", "prompt", "stage", "task")
"""Fields of an episode by which curves can be grouped, besides the rule."""

OPEN = "–"
"""Stands for a field that a header leaves empty."""

NO, UNKNOWN, YES = 0, 1, 2
"""Codes of V: not violated, inconclusive, violated; of several rules the greatest counts."""
CODES = {
    "pass": NO, "not_applicable": NO, "inconclusive": UNKNOWN, None: UNKNOWN, "violation": YES,
}  # fmt: skip
"""Verdict → code; None: not decided."""

COUNTS = ("success", "engagement", "risk", "code", "missing")
"""Columns of a segment that determine what it counts as."""

SEGMENT = pl.Schema(
    {
        "episode_id": pl.String(), "rule": pl.String(), "verdict": pl.String(),
        "risk": pl.Boolean(), "first": pl.Int64(), "stop": pl.Int64(),
    }
)  # fmt: skip
"""The values ``first`` … ``stop`` − 1 under which a rule gives one verdict on one episode.

``verdict`` is null where it is not decided; ``risk`` says whether the hazard was there (``at_risk``).
"""

Segment = tuple[Any, ...]
"""A row of ``SEGMENT``."""


@dataclass(frozen=True)
class Swept:
    """One episode: the result rows of its assigned rules, and the segments of those that read a parameter."""

    episode_id: str
    rows: Sequence[dict[str, Any]]
    segments: Sequence[Segment]


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
        segments: rows as in ``SEGMENT``, with what is known of their episodes (``with_episodes``).
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
        numbers: dict[tuple[str, ...], dict[tuple[Any, ...], Any]] = {}
        for row in segments.group_by(*by, *COUNTS, "first", "stop").len().iter_rows(named=True):
            group = numbers.setdefault(tuple(row[name] for name in by), {})
            kind = tuple(row[name] for name in COUNTS)
            steps = group.setdefault(kind, np.zeros(len(self.values) + 1, np.int64))
            steps[row["first"]] += row["len"]
            steps[row["stop"]] -= row["len"]
        return {key: self._curve(numbers[key]) for key in sorted(numbers)}

    def _curve(self, steps: dict[tuple[Any, ...], Any]) -> list[Rates]:
        """The rates under every value; ``steps``: by how many the episodes of a kind grow in number."""
        kinds = [(rates((_outcome(*kind),)), change.cumsum()) for kind, change in steps.items()]
        return [
            reduce(add, [one.times(int(count[i])) for one, count in kinds if count[i]], rates(()))
            for i in range(len(self.values))
        ]

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
    progress: Progress | None = None,
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
    again = again_by(rules, overrides or {}, bind)
    swept, problems = _judged(refs, again, param, rising, jobs, progress)
    if not any(one.segments for one in swept) and not problems:
        raise InputError(
            f"--param {param}",
            f"read by {', '.join(readers)}, which no episode is judged by.",
            fix="take traces whose headers assign one of them, or assign it with --bind",
        )
    return swept_over(rules, param, rising, swept, problems)


def swept_over(
    rules: RuleSet,
    param: str,
    values: tuple[ast.Setting, ...],
    swept: Sequence[Swept],
    problems: Sequence[Problem] = (),
) -> Sweep:
    """Put the episodes of a sweep together; ``values`` are rising."""
    segments = with_episodes(*_frames(swept))
    used = set(segments["rule"])
    return Sweep(
        param,
        values,
        rules.params[param],
        tuple(code for code in rules.scoped if code in used),
        sum(not one.segments for one in swept),
        tuple(problems),
        segments,
    )


def _judged(
    refs: Sequence[EpisodeRef],
    again: Callable[[Episode], Again],
    param: str,
    values: Sequence[ast.Setting],
    jobs: int | None,
    progress: Progress | None,
) -> tuple[list[Swept], list[Problem]]:
    work = partial(_swept_episode, again=again, param=param, values=values)
    swept, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    return list({one.episode_id: one for one in reversed(swept)}.values())[::-1], problems


def _swept_episode(
    ref: EpisodeRef, again: Callable[[Episode], Again], param: str, values: Sequence[ast.Setting]
) -> Swept:
    return sweep_episode(again(ref.open()), param, values)


def sweep_episode(again: Again, param: str, values: Sequence[ast.Setting]) -> Swept:
    """An episode under rising values; no segments if no assigned rule reads the parameter."""
    name, segments = again.episode.header.episode_id, list[Segment]()
    for rule in again.assigned:
        if param not in parameters_read(again.rules, rule):
            continue
        first = 0
        for (verdict, risk), same in groupby(_under_each(again, rule, param, values)):
            stop = first + len(list(same))
            segments.append((name, rule.code, verdict, risk, first, stop))
            first = stop
    rows = again.rows if segments else ()
    return Swept(name, [{column: row[column] for column in COLUMNS} for row in rows], segments)


def _under_each(
    again: Again, rule: ast.Scoped, param: str, values: Sequence[ast.Setting]
) -> list[tuple[str, bool]]:
    """The verdict of a rule under each of the rising values, and whether the hazard was there.

    The values at which it changes are found once; only those that they leave open are judged one by
    one.
    """
    pieces, out = list[Piece](), list[tuple[str, bool]]()
    if len(values) > FEW and told_in(values, si_unit(again.binding.params(rule)[param])):
        pieces = all_pieces(again, rule, [param], amount(values[-1]))[param]
    for value in values:
        piece = next((p for p in pieces if p.low <= amount(value) < p.high), None)
        if piece is None or piece.verdict is None:
            out.append(again.judged(rule, {param: value}))
        else:
            out.append((piece.verdict, piece.at_risk))
    return out


def sweep_table(
    table: FlipTable,
    param: str,
    values: Sequence[Any],
    *,
    judge_again: bool = True,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """The rates of a run under every value of a parameter.

    Args:
        table: rows and what-if table.
        param: the parameter.
        values: in SI, of the parameter's dimension.
        judge_again: open the traces of episodes that the table does not decide.
        jobs: worker processes for these.
        progress: called with (done, total) of these.

    Raises InputError for a parameter that the table is not about.
    """
    rules = load_rules(list(table.judging.rules))
    rising = tuple(sorted(values, key=amount))
    pieces = pieces_about(table, param, rising)
    numbers = np.array([amount(value) for value in rising])
    first, stop = (np.searchsorted(numbers, pieces[end].to_numpy()) for end in ("low", "high"))
    first[pieces["low"].to_numpy() == 0] = 0  # values below 0, which nothing decides, count to it
    segments = pieces.select(
        *KEYS, "verdict", pl.col("at_risk").alias("risk"),
        pl.Series("first", first), pl.Series("stop", stop),
    ).cast(SEGMENT).filter(pl.col("first") < pl.col("stop"))  # fmt: skip
    open_ids = segments.filter(pl.col("verdict").is_null())["episode_id"].unique().to_list()
    swept, problems = list[Swept](), list[Problem]()
    if open_ids and judge_again:
        refs = table.traces_of(open_ids)
        again = again_by(rules, table.judging.overrides, table.judging.bind)
        swept, problems = _judged(refs, again, param, rising, jobs, progress)
        kept = ~pl.col("episode_id").is_in([one.episode_id for one in swept])
        segments = pl.concat([segments.filter(kept), _frames(swept)[0]])
    return Sweep(
        param,
        rising,
        rules.params[param],
        tuple(sorted(pieces["rule"].unique().to_list())),
        table.rows["episode_id"].n_unique() - pieces["episode_id"].n_unique(),
        tuple(problems),
        with_episodes(segments, table.rows),
        len(swept),
        segments.filter(pl.col("verdict").is_null())["episode_id"].n_unique(),
    )


def _frames(swept: Sequence[Swept]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Segments and result rows of some episodes."""
    segments = [segment for one in swept for segment in one.segments]
    rows = [tuple(row.values()) for one in swept for row in one.rows]
    return pl.DataFrame(segments, SEGMENT, orient="row"), pl.DataFrame(rows, COLUMNS, orient="row")


def with_episodes(segments: pl.DataFrame, rows: pl.DataFrame) -> pl.DataFrame:
    """Segments with what is known of their episodes.

    Besides ``FIELDS``, ``success`` and ``engagement``: ``code``, of the segment's verdict; ``missing``, an
    assigned rule of the episode is not loaded; ``rest`` and ``rest_at_risk``, the greatest code and any risk
    of its assigned rules that do not read the parameter.
    """
    code = pl.col("verdict").cast(pl.String).replace_strict(CODES, return_dtype=pl.Int8)
    reading = segments.select(KEYS).unique().with_columns(pl.lit(value=True).alias("reads"))
    absent = (pl.col("vacuity") == "not_loaded").fill_null(value=False)
    rest = pl.col("reads").is_null() & ~absent
    episodes = (
        rows.join(reading, on=KEYS, how="left")
        .with_columns(was_at_risk(), code.alias("code"))
        .group_by("episode_id")
        .agg(
            *(pl.col(name).first().fill_null(OPEN) for name in FIELDS),
            pl.col("success").first(),
            pl.col("engagement").first(),
            absent.any().alias("missing"),
            pl.col("code").filter(rest).max().fill_null(NO).alias("rest"),
            pl.col("at_risk").filter(rest).any().alias("rest_at_risk"),
        )
    )
    return segments.with_columns(code.alias("code")).join(episodes, on="episode_id")


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
