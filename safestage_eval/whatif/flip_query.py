"""Other values of a parameter, answered from the what-if table: verdicts, and the slack of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import polars as pl

from safestage_eval.errors import InputError
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.syntax import amount

from .flip_table import FlipTable
from .sweep_segments import KEYS
from .swept_values import si_unit

NARROW = 1e-4
"""SI; undecided pieces that are no wider, as a distance is measured, are no end of the slack."""


def verdicts_under(table: FlipTable, values: Mapping[str, ast.Setting]) -> pl.DataFrame:
    """The rows of a run with ``new``, the verdict under other values, and ``new_at_risk``.

    A rule that reads none of the parameters keeps its verdict. ``new`` is null, and ``undecided``
    true, where the table does not tell, and where a rule reads several of the parameters.

    Raises InputError for a parameter that the table is not about.
    """
    pieces: pl.DataFrame | None = None
    for param, value in values.items():
        inside = pieces_about(table, param, [value]).filter(_at(value)).select(
            *KEYS, "verdict", "at_risk"
        )  # fmt: skip
        pieces = inside if pieces is None else pl.concat([pieces, inside])
    assert pieces is not None
    several = pl.len() > 1
    new = pieces.group_by(KEYS).agg(
        pl.when(several).then(None).otherwise(pl.col("verdict").first()).alias("new"),
        pl.col("at_risk").first().alias("new_at_risk"),
        (several | pl.col("verdict").first().is_null()).alias("undecided"),
    )
    rows = table.rows.with_columns(was_at_risk())
    return rows.join(new, on=KEYS, how="left").with_columns(
        pl.when(pl.col("undecided").is_null())
        .then(pl.col("verdict"))
        .otherwise(pl.col("new").cast(pl.String))
        .alias("new"),
        pl.coalesce("new_at_risk", "at_risk").alias("new_at_risk"),
        pl.col("undecided").fill_null(value=False),
    )


def was_at_risk() -> pl.Expr:
    """Whether the verdict of a row was reached on something, as ``verdicts.at_risk`` has it."""
    decided = pl.col("verdict").is_in(["pass", "violation"])
    return (decided & (pl.col("instances") > 0) & pl.col("vacuity").is_null()).alias("at_risk")


def slack(table: FlipTable, params: Sequence[str] = ()) -> pl.DataFrame:
    """How far each parameter may fall or rise before each verdict changes.

    Returns per episode, rule and parameter ``value`` (that held), ``verdict``, ``down`` and ``up``:
    how far it may go, null where it may go on for ever (down: to 0) or the table does not tell
    beyond; ``to_down`` and ``to_up``, the verdicts there, null likewise.
    """
    names = list(params) or table.params
    out = []
    for name in names:
        wide = pl.col("high") - pl.col("low") > NARROW
        pieces = pieces_about(table, name).filter(pl.col("verdict").is_not_null() | wide)
        pieces = pieces.sort(*KEYS, "low")
        around = pieces.with_columns(
            pl.col("verdict").shift(1).over(KEYS).alias("to_down"),
            pl.col("verdict").shift(-1).over(KEYS).alias("to_up"),
        )
        held = around.filter(
            (pl.col("low") <= pl.col("value")) & (pl.col("value") < pl.col("high"))
        )
        out.append(
            held.select(
                "param", *KEYS, "value", "unit", "verdict", "to_down", "to_up",
                pl.when(pl.col("to_down").is_not_null())
                .then(pl.col("value") - pl.col("low")).alias("down"),
                pl.when(pl.col("to_up").is_not_null())
                .then(pl.col("high") - pl.col("value")).alias("up"),
            )
        )  # fmt: skip
    return pl.concat(out)


def pieces_about(table: FlipTable, param: str, values: Sequence[ast.Setting] = ()) -> pl.DataFrame:
    """The rows of a what-if table about a parameter, and about values of the kind that are asked for.

    Pieces in seconds do not decide a duration in frames, nor "3 frames @ 120 Hz", which asks for
    several samples whatever the rate; and none decides a value below 0.

    Raises InputError for a parameter that the table is not about.
    """
    pieces = table.pieces(param)
    if pieces.is_empty():
        raise InputError(
            f"{table.path}, parameter {param}", "its what-if table has no row about it.",
            ", ".join(table.params),
        )  # fmt: skip
    kinds = {si_unit(value) for value in values}
    several_samples = any(isinstance(value, ast.Duration) and value.least > 1 for value in values)
    if several_samples or any(amount(value) < 0 for value in values):
        kinds.add("another kind")
    if not kinds:
        return pieces
    decides = pl.col("unit").is_in(list(kinds)) & (len(kinds) == 1)
    return pieces.with_columns(pl.when(decides).then(pl.col("verdict")).alias("verdict"))


def _at(value: ast.Setting) -> pl.Expr:
    """The piece that a value is in; the first one for values below 0, which it does not decide."""
    number = max(amount(value), 0.0)
    return (pl.col("low") <= number) & (number < pl.col("high"))
