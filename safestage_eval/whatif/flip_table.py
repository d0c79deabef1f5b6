"""The what-if table: the verdict of every assigned rule on all values of every parameter it reads.

A row says that on the values [low, high) of one parameter, all others as they were, a rule gives one
verdict on one episode; the rows of an episode, rule and parameter cover all values from 0 on. Where
``verdict`` is null the episode has to be judged again. The table is a Parquet file beside the rows
of ``safestage score``: ``rows.parquet`` and ``rows.what-if.parquet``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.formats.atomic import replacing
from safestage_eval.rules import RuleSet, load_bind, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.problem import Problem

from .each_episode import each_episode
from .flips import pieces_of
from .judge_again import Again
from .swept_values import si_unit

SUFFIX = ".what-if.parquet"
KEY = b"safestage"
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

Row = tuple[str, str, str, float, float, "str | None", bool, float, str]


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
        output: the Parquet file.
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
        episode_rows,
        rules=rules,
        overrides=dict(judging.overrides),
        bind=None if judging.bind is None else load_bind(judging.bind, rules),
        params=None if params is None else frozenset(params),
    )
    per_episode, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    save(output, (row for rows in per_episode for row in rows), judging)
    return problems


def save(output: Path, rows: Iterable[Row], judging: Judging) -> None:
    """Write rows, by parameter, so that one parameter is read without the others."""
    frame = pl.DataFrame(list(rows), schema=SCHEMA, orient="row").sort(
        "param", "episode_id", "rule", "low"
    )
    judged_by = {
        "rules": list(judging.rules),
        "overrides": dict(judging.overrides),
        "bind": judging.bind,
    }
    with replacing(output) as temporary:
        frame.write_parquet(
            temporary, compression="zstd", row_group_size=20_000,
            metadata={KEY.decode(): json.dumps(judged_by)},
        )  # fmt: skip


def episode_rows(
    ref: EpisodeRef,
    *,
    rules: RuleSet,
    overrides: Mapping[str, str],
    bind: BindFile | None,
    params: frozenset[str] | None,
) -> list[Row]:
    """The rows of one episode: of each assigned rule and each parameter that it reads."""
    again = Again(ref.open(), rules, overrides, bind)
    header, out = again.episode.header, list[Row]()
    for rule in again.assigned:
        read = parameters_read(rules, rule)
        for param in sorted(read if params is None else read & params):
            out += _rows(again, rule, param, header.episode_id)
    return out


def _rows(again: Again, rule: ast.Scoped, param: str, episode_id: str) -> list[Row]:
    players = again.binding.players(rule, again.episode.header)
    base, now = again.base(rule)
    usual = base.params[param]
    value, unit = amount(usual), si_unit(usual)
    if not all(players.values()):  # whatever the value
        pieces: Any = [(0.0, float("inf"), now.verdict, False)]
    elif isinstance(rule, ast.Cost) or moves_success(again, param):
        pieces = [(0.0, float("inf"), None, False)]
    else:
        pieces = pieces_of(base, rule, players, param)
    return [
        (param, episode_id, rule.code, low, high, verdict, risk, value, unit)
        for low, high, verdict, risk in pieces
    ]


def moves_success(again: Again, param: str) -> bool:
    """Success is not recorded, and the goal that tells it reads the parameter."""
    header, goal = again.episode.header, again.binding.goal
    recorded = header.success is False or (header.success and header.success_time is not None)
    return not recorded and goal is not None and param in parameters_read(again.rules, goal)


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
            judged_by = json.loads(pl.read_parquet_metadata(self.beside)[KEY.decode()])
        except (pl.exceptions.PolarsError, KeyError, ValueError) as error:
            raise InputError(
                str(path), f"cannot be read: {error}.", "what safestage score wrote"
            ) from None
        self.judging = Judging(tuple(judged_by["rules"]), judged_by["overrides"], judged_by["bind"])

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


COLUMNS = (
    "episode_id", "path", "task", "stage", "policy", "prompt", "success", "engagement", "rule",
    "assigned", "verdict", "vacuity", "instances",
)  # fmt: skip
"""The columns of a run that are read."""


def is_result_file(path: str | Path) -> bool:
    """A Parquet file of result rows, not one of traces."""
    try:
        return Path(path).is_file() and set(COLUMNS) <= pl.read_parquet_schema(path).keys()
    except (pl.exceptions.PolarsError, OSError):
        return False
