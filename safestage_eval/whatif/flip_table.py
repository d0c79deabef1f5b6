"""The what-if table: the verdict of every assigned rule on all values of every parameter it reads.

A row says that on the values [low, high) of one parameter, all others as they were, a rule gives one
verdict on one episode; the rows of an episode, rule and parameter cover all values from 0 on. Where
``verdict`` is null the episode has to be judged again. The table is a Parquet file beside the rows
of ``safestage score``: ``rows.parquet`` and ``rows.what-if.parquet``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.formats.atomic import writing
from safestage_eval.rules import load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.problem import Problem

from .each_episode import each_episode
from .judge_again import Again, again_by
from .swept_values import si_unit, told_in
from .value_ranges import all_pieces

SUFFIX = ".what-if.parquet"
KEY = "safestage"
"""Metadata of the file: by which rules and values it was judged."""

VERDICTS = ("pass", "violation", "inconclusive", "not_applicable")

SCHEMA = pl.Schema(
    {
        "param": pl.String(),
        "episode_id": pl.String(),
        "rule": pl.String(),
        "low": pl.Float64(),
        "high": pl.Float64(),
        "verdict": pl.Enum(VERDICTS),
        "at_risk": pl.Boolean(),
        "value": pl.Float64(),
        "unit": pl.String(),
    }
)
"""``value`` is what held when the episode was judged; values are in ``unit``: SI, s or frames."""

KEYS = ["episode_id", "rule"]
"""Columns by which rows of the table and of the results belong together."""

NARROW = 1e-4
"""SI; undecided pieces that are no wider, as a distance is measured, are no end of the slack."""


@dataclass(frozen=True)
class Judging:
    """How the episodes of a table were judged, so that some can be judged again.

    Attributes:
        rules: rule files, folders and built-in names.
        overrides: parameter → value as written.
        bind: a bind file.
    """

    rules: tuple[str, ...]
    overrides: Mapping[str, str]
    bind: str | None = None


def path_beside(rows: str | Path) -> Path:
    """Where the what-if table of a result file is."""
    rows = Path(rows)
    return rows.with_name(rows.stem + SUFFIX)


def write_table(
    output: Path,
    refs: Sequence[EpisodeRef],
    judging: Judging,
    *,
    params: Collection[str] | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Problem]:
    """Judge episodes along every parameter and write their what-if table.

    Args:
        output: the Parquet file, sorted by parameter, so that one is read without the others.
        refs: the episodes.
        judging: rules and values.
        params: names of parameters; all that a rule reads if None.
        jobs: worker processes.
        progress: called with (done, total).

    Returns the episodes that could not be judged. Raises as ``load_rules``.
    """
    rules = load_rules(list(judging.rules))
    unknown = sorted(set(params or ()) - rules.params.keys())
    if unknown:
        raise InputError(
            f"--what-if {','.join(unknown)}", "no loaded rule file declares it.",
            "all, or names of parameters",
        )  # fmt: skip
    work = partial(
        _episode_rows,
        again=again_by(rules, judging.overrides, judging.bind),
        params=frozenset(rules.params if params is None else params),
    )
    per_episode, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    frame = pl.DataFrame([row for rows in per_episode for row in rows], SCHEMA, orient="row")
    with writing(output) as temporary:
        frame.sort("param", "episode_id", "rule", "low").write_parquet(
            temporary, compression="zstd", row_group_size=20_000,
            metadata={KEY: json.dumps(asdict(judging))},
        )  # fmt: skip
    return problems


def _episode_rows(
    ref: EpisodeRef, *, again: Callable[[Episode], Again], params: frozenset[str]
) -> list[tuple[Any, ...]]:
    """The rows of one episode: of each assigned rule and each parameter that it reads."""
    judged, out = again(ref.open()), list[tuple[Any, ...]]()
    for rule in judged.assigned:
        values = judged.binding.params(rule)
        read = sorted(parameters_read(judged.rules, rule) & params)
        for param, pieces in all_pieces(judged, rule, read).items():
            held = amount(values[param]), si_unit(values[param])
            name = judged.episode.header.episode_id
            out += [(param, name, rule.code, *piece, *held) for piece in pieces]
    return out


class FlipTable:
    """The result rows of a run with the what-if table beside them.

    Attributes:
        path: the result file.
        beside: the what-if table.
        rows: of assigned rules, with ``COLUMNS``.
        judging: the rules and values that they were judged by.
    """

    def __init__(self, path: str | Path) -> None:
        """Raises InputError where either file is missing or is no such table."""
        self.path = Path(path)
        self.beside = path_beside(path)
        if not self.path.is_file():
            raise InputError(
                str(path),
                "a folder, not a result file." if self.path.is_dir() else "no such file.",
                "rows.parquet, written by safestage score",
                "safestage score TRACES --what-if all -f parquet -o rows.parquet",
            )
        if not self.beside.is_file():
            raise InputError(
                str(path),
                f"no what-if table stands beside it ({self.beside.name}).",
                fix=f"safestage score TRACES -f parquet -o {self.path.name} --what-if all",
            )
        try:
            self.rows = pl.read_parquet(self.path, columns=list(COLUMNS)).filter("assigned")
            judged_by = json.loads(pl.read_parquet_metadata(self.beside)[KEY])
            self.judging = Judging(**judged_by)
        except (pl.exceptions.PolarsError, KeyError, ValueError, TypeError) as error:
            raise InputError(
                str(path), f"cannot be read: {error}.", "what safestage score wrote"
            ) from None

    def pieces(self, param: str) -> pl.DataFrame:
        """The rows of the what-if table about one parameter."""
        return pl.scan_parquet(self.beside).filter(pl.col("param") == param).collect()

    def traces_of(self, ids: Sequence[str]) -> list[EpisodeRef]:
        """The traces of some episodes, as far as they are where they were judged."""
        paths = self.rows.filter(pl.col("episode_id").is_in(list(ids)))["path"].unique()
        there = sorted(path for path in paths.to_list() if path and Path(path).exists())
        try:
            refs = {ref.episode_id: ref for ref in discover(there)} if there else {}
        except InputError:
            return []
        return [refs[name] for name in ids if name in refs]

    @property
    def params(self) -> list[str]:
        """Names of the parameters that the table is about."""
        names = pl.scan_parquet(self.beside).select(pl.col("param").unique()).collect()
        return sorted(names["param"].to_list())


COLUMNS = pl.Schema(
    {
        "episode_id": pl.String(), "path": pl.String(), "task": pl.String(), "stage": pl.String(),
        "policy": pl.String(), "prompt": pl.String(), "success": pl.Boolean(),
        "engagement": pl.String(), "rule": pl.String(), "assigned": pl.Boolean(),
        "verdict": pl.String(), "vacuity": pl.String(), "instances": pl.Int64(),
    }
)  # fmt: skip
"""The columns of a run that are read."""


def is_result_file(path: str | Path) -> bool:
    """A Parquet file of result rows, not one of traces."""
    try:
        return Path(path).is_file() and set(COLUMNS) <= pl.read_parquet_schema(path).keys()
    except (pl.exceptions.PolarsError, OSError):
        return False


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

    Raises InputError for an empty table, and for a parameter that the table is not about.
    """
    names = list(params) or table.params
    if not names:
        raise InputError(
            str(table.path), "its what-if table is empty: no assigned rule reads a parameter of it.",
            fix=f"safestage score TRACES -f parquet -o {table.path.name} --what-if all",
        )  # fmt: skip
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
    """The rows of a what-if table about a parameter, undecided where they do not tell of all the values.

    Raises InputError for a parameter that the table is not about.
    """
    pieces = table.pieces(param)
    if pieces.is_empty():
        raise InputError(
            f"{table.path}, parameter {param}", "its what-if table has no row about it.",
            ", ".join(table.params),
        )  # fmt: skip
    units = [unit for unit in pieces["unit"].unique() if told_in(values, unit)]
    told = pl.col("unit").is_in(units)
    return pieces.with_columns(pl.when(told).then(pl.col("verdict")).alias("verdict"))


def _at(value: ast.Setting) -> pl.Expr:
    """The piece that a value is in; the first one for values below 0, which it does not decide."""
    number = max(amount(value), 0.0)
    return (pl.col("low") <= number) & (number < pl.col("high"))
