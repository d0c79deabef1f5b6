"""A sweep over the rows of a run: every value of a parameter, answered from the what-if table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from safestage_eval.rules import load_bind, load_rules
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.problem import Problem

from .each_episode import each_episode
from .flip_query import pieces_about, was_at_risk
from .flip_table import FlipTable
from .sweep import Sweep
from .sweep_segments import (
    CODES,
    FIELDS,
    KEYS,
    NO,
    OPEN,
    SEGMENTS,
    segment_frame,
    sweep_episode,
)


def sweep_table(
    table: FlipTable,
    param: str,
    values: Sequence[Any],
    *,
    judge_again: bool = True,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
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
    segments = _segments(table, pieces, np.array([amount(value) for value in rising]))
    open_ids = segments.filter(pl.col("verdict").is_null())["episode_id"].unique().to_list()
    again, problems = 0, list[Problem]()
    if open_ids and judge_again:
        bind = table.judging.bind
        work = partial(
            sweep_episode, rules=rules, param=param, values=rising,
            overrides=dict(table.judging.overrides),
            bind=None if bind is None else load_bind(bind, rules),
        )  # fmt: skip
        refs = table.traces_of(open_ids)
        swept, problems = each_episode(refs, work, jobs=jobs, progress=progress)
        judged = dict(swept)
        anew = segment_frame([row for rows in judged.values() for row in rows])
        again = anew["episode_id"].n_unique()
        kept = segments.filter(~pl.col("episode_id").is_in(list(judged)))
        segments = pl.concat([kept, anew])
    return Sweep(
        param,
        rising,
        rules.params[param],
        tuple(sorted(pieces["rule"].unique().to_list())),
        table.rows["episode_id"].n_unique() - pieces["episode_id"].n_unique(),
        tuple(problems),
        segments,
        again,
        segments.filter(pl.col("verdict").is_null())["episode_id"].n_unique(),
    )


def _segments(table: FlipTable, pieces: pl.DataFrame, values: NDArray[np.float64]) -> pl.DataFrame:
    """The segments of rising values that lie in each piece, as in ``sweep.SEGMENTS``."""
    first = np.searchsorted(values, pieces["low"].to_numpy())
    stop = np.searchsorted(values, pieces["high"].to_numpy())
    lowest = pieces["low"].to_numpy() == 0  # values below 0, which nothing decides, count to it
    first = np.where(lowest, 0, first)
    held = pieces.select(*KEYS, "verdict", pl.col("at_risk").alias("risk")).with_columns(
        pl.Series("first", first), pl.Series("stop", stop), _code_of("verdict")
    )
    reading = pieces.select(KEYS).unique().with_columns(pl.lit(value=True).alias("reads"))
    rows = table.rows.with_columns(was_at_risk(), _code_of("verdict"))
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
    segments = held.filter(pl.col("first") < pl.col("stop")).join(episodes, on="episode_id")
    return segments.select(pl.col(name).cast(kind) for name, kind in SEGMENTS.items())


def _code_of(column: str) -> pl.Expr:
    """The code of a verdict, as in ``sweep.CODES``."""
    verdict = pl.col(column).cast(pl.String)
    return verdict.replace_strict(CODES, return_dtype=pl.Int8).alias("code")
