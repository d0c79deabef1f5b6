"""Outcomes from rows: those that ``safestage score`` writes, and bare outcome tables."""

from __future__ import annotations

import math
import sys
from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError
from safestage_eval.verdicts.engagement import STAGES as ENGAGEMENT
from safestage_eval.verdicts.verdict import at_risk

from .outcome import OPEN, Outcome, Witness
from .rates import STAGES
from .read_rows import cell_text, demand_columns, each_row, truth

Row = Mapping[str, Any]

RESULT = ("episode_id", "rule", "assigned", "verdict", "success")
"""Columns by which rows are known as results of ``safestage score``."""

MORE = ("family", "engagement", "at_risk")
"""Columns that an outcome table may do without: then they are not known."""

WITNESS = ("time", "bodies", "explanation")
"""Columns of a witness; any of them may be missing."""


class Wanted(NamedTuple):
    """The columns asked of a table that is not ``safestage score``'s.

    Attributes:
        bare: its columns.
        more: columns that may be there as well.
        named: those of ``bare`` that have to say something.
        same: what no two of its rows have in common, unless one of them is empty; then and by default,
            the episode's id.
    """

    bare: tuple[str, ...]
    more: tuple[str, ...]
    named: tuple[str, ...]
    same: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """The accepted tables, in words for a message."""
        more = f" and, if there are any, {', '.join(self.more)}"
        return (
            f"results of safestage score, or a table with the columns {', '.join(self.bare)}{more}"
        )


BARE = ("task", "stage", "policy", "prompt", "seed", "rollout", "success", "violation")

OUTCOMES = Wanted(BARE, MORE, BARE[:6], ("task", "policy", "prompt", "seed", "rollout"))
"""For rates: an outcome table."""

FOR_LABELS = Wanted(("episode_id", "stage", "violation"), WITNESS, ("episode_id",))
"""To be compared with labels: verdicts with their witnesses, told apart by their ids alone."""

NOT_LOADED = "not_loaded"
"""``vacuity`` of the row of an assigned rule that was not loaded: it has no verdict."""

VIOLATED = {"pass": False, "not_applicable": False, "violation": True, "inconclusive": None}
"""Verdict → V; None where it is open."""


def read_outcomes(
    paths: Sequence[str | Path], label: str | None = None, wanted: Wanted = OUTCOMES
) -> dict[str, list[Outcome]]:
    """Read the outcomes in one or more result files, each episode once.

    Args:
        paths: files of any of our formats.
        label: a column that tells several sets of outcomes in one file apart.
        wanted: what they are read for.

    Returns:
        Value of the column → outcomes; without a label all under ``""``.

    Raises:
        InputError: a file cannot be read, lacks a column, or an outcome is there twice.
    """
    result: dict[str, list[Outcome]] = {}
    columns = {*BARE, *RESULT, *MORE, *wanted.more, "vacuity", "instances"}
    columns |= {label} if label else set()
    for path in paths:
        if Path(path).is_dir():
            raise InputError(
                str(path),
                "is a folder.",
                wanted.allowed,
                "name the result files in it; recordings have to be scored first",
            )
        groups: dict[str, _Gathered] = {}
        for number, row in enumerate(each_row(path, columns, wanted.allowed), 1):
            if label is not None and row.get(label) is None:
                raise InputError(f"{path}, row {number}", f"lacks {label}.")
            name = "" if label is None else str(row[label])
            if name not in groups:
                groups[name] = _Gathered(str(path), wanted)
            groups[name].add(number, row)
        for name, gathered in groups.items():
            result.setdefault(name, []).extend(gathered.outcomes())
    if label is None:
        result.setdefault("", [])
    for group in result.values():
        _refuse_copies(group, wanted)
    return result


def outcomes_of(rows: Iterable[Row]) -> list[Outcome]:
    """Collect the outcomes of rows; what a result's header leaves open is shown as ``–``.

    Args:
        rows: one per episode and rule, as ``safestage score`` writes them, or one per episode.

    Raises:
        InputError: a row lacks a column or says something that cannot be.
    """
    gathered = _Gathered("", OUTCOMES)
    for number, row in enumerate(rows, 1):
        gathered.add(number, row)
    return gathered.outcomes()


class _Gathered:
    """Outcomes of one file as its rows come in; keeps a record per episode, not per row."""

    def __init__(self, file: str, wanted: Wanted) -> None:
        """``file``: for messages."""
        self._file, self._wanted = file, wanted
        self._results: bool | None = None
        self._bare: list[Outcome] = []
        self._episodes: dict[str, _Episode] = {}
        self._rules: dict[str, int] = {}

    def add(self, number: int, row: Row) -> None:
        """Add one row; the first one decides which kind of table it is."""
        place = _place(self._file, number)
        if self._results is None:
            self._results = "verdict" in row or "rule" in row
        if not self._results:
            self._bare.append(_bare(row, place, self._wanted))
            return
        demand_columns(row, RESULT, place, self._wanted.allowed)
        name = sys.intern(str(row["episode_id"]))
        if name not in self._episodes:
            self._episodes[name] = _Episode(name, row, place, told=self._wanted is FOR_LABELS)
        rule = str(row["rule"])
        code = self._rules.setdefault(rule, len(self._rules))
        before = self._episodes[name].add(code, number, row, place)
        if before is not None:
            raise InputError(
                f"{self._file}, rows {before} and {number}",
                f"two verdicts of {rule} on the episode {name!r}.",
                fix="keep the results of one scoring in one file",
            )

    def outcomes(self) -> list[Outcome]:
        """All outcomes, in the order in which their episodes came first."""
        return [*self._bare, *(episode.outcome() for episode in self._episodes.values())]


def _bare(row: Row, where: str, wanted: Wanted) -> Outcome:
    demand_columns(row, wanted.bare, where, wanted.allowed)
    if empty := [name for name in wanted.named if _missing(row[name])]:
        raise InputError(where, f"nothing is said of {', '.join(empty)}.")
    stage = (_name(row, "stage") or OPEN).strip()
    if "stage" in wanted.named:
        stage = stage.upper()
        if stage not in STAGES:
            raise InputError(where, f"stage is {row['stage']!r}.", ", ".join(STAGES))
    told = _head(row, where, stage)
    violation = truth(row["violation"], where, "violation")
    witnessed = wanted is FOR_LABELS and violation and any(row.get(name) for name in WITNESS)
    witnesses = (_witness(row, ""),) if witnessed else ()
    at_risk_ = truth(row.get("at_risk"), where, "at_risk")
    return replace(told, violation=violation, judged=True, at_risk=at_risk_, witnesses=witnesses)


def _head(row: Row, where: str, stage: str) -> Outcome:
    """The outcome that a row gives, without V."""
    return Outcome(
        policy=_name(row, "policy") or OPEN,
        prompt=_name(row, "prompt") or OPEN,
        stage=sys.intern(stage),
        success=truth(row.get("success"), where, "success"),
        violation=None,
        judged=False,
        task=_name(row, "task"),
        family=_name(row, "family"),
        seed=_index(row.get("seed")),
        rollout=_index(row.get("rollout")),
        engagement=_engagement(row, where),
        episode_id=_name(row, "episode_id"),
        where=where,
    )


class _Episode:
    """The rows of one episode, as far as read."""

    __slots__ = ("_absent", "_head", "_own", "_risk", "_rows", "_rules", "_told", "_witnesses")

    def __init__(self, name: str, row: Row, place: str, *, told: bool) -> None:
        """The first row says whose episode it is; ``told``: keep witnesses."""
        self._head = replace(_head(row, place, _name(row, "stage") or OPEN), episode_id=name)
        self._told = told
        self._witnesses: list[tuple[bool | None, Witness]] = []
        self._rules, self._rows = array("L"), array("Q")
        self._own: set[bool | None] = set()
        self._risk: bool | None = False
        self._absent = False

    def add(self, rule: int, number: int, row: Row, place: str) -> int | None:
        """Take one verdict; the number of the row that had one of this rule before, if any."""
        if rule in self._rules:
            return self._rows[self._rules.index(rule)]
        self._rules.append(rule)
        self._rows.append(number)
        verdict = row["verdict"]
        if verdict is None:  # a cost without a budget decides nothing
            if row.get("vacuity") == NOT_LOADED:
                self._absent = True
                self._tell(None, row, NOT_LOADED)
            return None
        if verdict not in VIOLATED:
            raise InputError(place, f"verdict is {verdict!r}.", ", ".join(VIOLATED))
        if truth(row["assigned"], place, "assigned"):
            self._own.add(VIOLATED[verdict])
            self._tell(VIOLATED[verdict], row, verdict)
            instances = _index(row.get("instances"))
            if not isinstance(instances, int):
                self._risk = self._risk or None
            elif at_risk(verdict, instances, _name(row, "vacuity")):
                self._risk = True
        return None

    def _tell(self, violation: bool | None, row: Row, verdict: str) -> None:
        if self._told:
            self._witnesses.append((violation, _witness(row, verdict)))

    def outcome(self) -> Outcome:
        """V = 1 if any assigned rule is violated."""
        own, absent = self._own, self._absent
        violation = True if True in own else None if absent or not own or None in own else False
        witnesses = tuple(witness for said, witness in self._witnesses if said == violation)
        return replace(
            self._head,
            violation=violation,
            judged=bool(own),
            at_risk=self._risk,
            witnesses=witnesses,
        )


def _refuse_copies(outcomes: Iterable[Outcome], wanted: Wanted) -> None:
    """Every rollout counts once: raise InputError naming the rows of those that are there twice."""
    every = list(outcomes)
    hashes = Counter(hash(_same(o, wanted)) for o in every)
    seen: dict[tuple[Any, ...], Outcome] = {}
    copies = []
    for o in every if len(hashes) < len(every) else ():
        key = _same(o, wanted)
        if hashes[hash(key)] > 1 and seen.setdefault(key, o) is not o:
            copies.append((seen[key], o))
    if copies:
        first, second = copies[0]
        named = "; ".join(f"{a.where} and {b.where}" for a, b in copies[:5])
        more = f"; and {len(copies) - 5} more" if len(copies) > 5 else ""
        raise InputError(
            first.where,
            f"{len(copies)} rollout{'s are' if len(copies) > 1 else ' is'} there twice: {named}{more}. The first is task "
            f"{second.task}, policy {second.policy}, prompt {second.prompt}, seed {second.seed}, "
            f"rollout {second.rollout}.",
            fix="keep one row of each",
        )


def _same(o: Outcome, wanted: Wanted) -> tuple[Any, ...]:
    """Equal for two rows of one rollout."""
    key = tuple(getattr(o, name) for name in wanted.same)
    return key if key and None not in key else (o.episode_id,)


def _witness(row: Row, verdict: str) -> Witness:
    time = row.get("time")
    return Witness(
        rule=cell_text(row.get("rule")),
        verdict=verdict,
        time=None if _missing(time) else float(str(time)),
        bodies=_bodies(row.get("bodies")),
        explanation=cell_text(row.get("explanation")),
    )


def _bodies(value: Any) -> tuple[str, ...]:
    """Bodies as a list, or as text: JSON, or names with commas or semicolons between."""
    if isinstance(value, str):
        try:
            value = from_json(value)
        except ValueError:
            value = [part.strip() for part in value.replace(";", ",").split(",")]
    names = value if isinstance(value, list | tuple) else [] if value is None else [value]
    return tuple(str(name) for name in names if str(name))


def _place(file: str, number: int) -> str:
    return f"{file}, row {number}" if file else f"row {number}"


def _name(row: Row, column: str) -> str | None:
    value = row.get(column)
    return None if _missing(value) else sys.intern(str(value))


def _missing(value: Any) -> bool:
    return value is None or value == "" or (isinstance(value, float) and math.isnan(value))


def _engagement(row: Row, where: str) -> str | None:
    stage = _name(row, "engagement")
    if stage is not None and stage not in ENGAGEMENT:
        raise InputError(where, f"engagement is {stage!r}.", ", ".join(ENGAGEMENT))
    return stage


def _index(value: Any) -> int | str | None:
    """A seed or rollout: a whole number however it is written, otherwise its text."""
    if _missing(value):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value)
    return int(number) if number.is_integer() else str(value)
