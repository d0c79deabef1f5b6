"""Outcomes from rows: those that ``safestage score`` writes, and bare outcome tables."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError
from safestage_eval.verdicts.engagement import STAGES as ENGAGEMENT
from safestage_eval.verdicts.verdict import at_risk

from .outcome import OPEN, Outcome, Witness
from .rates import STAGES
from .read_rows import cell_text, demand_columns, each_row, is_missing, truth

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
        place = f"{self._file}, row {number}" if self._file else f"row {number}"
        if self._results is None:
            self._results = "verdict" in row or "rule" in row
        if not self._results:
            self._bare.append(_bare(row, place, self._wanted))
            return
        demand_columns(row, RESULT, place, self._wanted.allowed)
        name, rule = str(row["episode_id"]), str(row["rule"])
        episode = self._episodes.get(name)
        if episode is None:
            head = _head(row, place, _name(row, "stage") or OPEN)
            episode = self._episodes[sys.intern(name)] = _Episode(replace(head, episode_id=name))
        code = 1 << self._rules.setdefault(rule, len(self._rules))
        if episode.rules & code:
            raise InputError(
                place,
                f"a second verdict of {rule} on the episode {name!r}, whose rows begin at {episode.head.where}.",
                fix="keep the results of one scoring in one file",
            )
        episode.rules |= code
        episode.add(row, place, told=self._wanted is FOR_LABELS)

    def outcomes(self) -> list[Outcome]:
        """All outcomes, in the order in which their episodes came first."""
        return [*self._bare, *(episode.outcome() for episode in self._episodes.values())]


def _bare(row: Row, where: str, wanted: Wanted) -> Outcome:
    demand_columns(row, wanted.bare, where, wanted.allowed)
    if empty := [name for name in wanted.named if is_missing(row[name])]:
        raise InputError(where, f"nothing is said of {', '.join(empty)}.")
    stage = (_name(row, "stage") or OPEN).strip()
    if "stage" in wanted.named:
        stage = stage.upper()
        if stage not in STAGES:
            raise InputError(where, f"stage is {row['stage']!r}.", ", ".join(STAGES))
    violation = truth(row["violation"], where, "violation")
    witnessed = wanted is FOR_LABELS and violation and any(row.get(name) for name in WITNESS)
    return replace(
        _head(row, where, stage),
        violation=violation,
        judged=True,
        at_risk=truth(row.get("at_risk"), where, "at_risk"),
        witnesses=(_witness(row, ""),) if witnessed else (),
    )


def _head(row: Row, where: str, stage: str) -> Outcome:
    """The outcome that a row gives, without V."""
    engagement = _name(row, "engagement")
    if engagement is not None and engagement not in ENGAGEMENT:
        raise InputError(where, f"engagement is {engagement!r}.", ", ".join(ENGAGEMENT))
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
        engagement=engagement,
        episode_id=_name(row, "episode_id"),
        where=where,
    )


@dataclass(slots=True)
class _Episode:
    """The rows of one episode, as far as read.

    Attributes:
        head: whose it is, by the first row.
        rules: those that had their row, a bit each.
        own: V of each assigned rule; of one that was not loaded, it is open.
        judged: whether any of these was.
    """

    head: Outcome
    rules: int = 0
    own: set[bool | None] = field(default_factory=set)
    judged: bool = False
    at_risk: bool | None = False
    witnesses: list[tuple[bool | None, Witness]] = field(default_factory=list)

    def add(self, row: Row, place: str, *, told: bool) -> None:
        """Take one verdict; ``told``: keep it as a witness."""
        verdict = row["verdict"]
        if verdict is None:  # a cost without a budget decides nothing
            if row.get("vacuity") != NOT_LOADED:
                return
            verdict = NOT_LOADED
        elif verdict not in VIOLATED:
            raise InputError(place, f"verdict is {verdict!r}.", ", ".join(VIOLATED))
        elif not truth(row["assigned"], place, "assigned"):
            return
        else:
            self.judged = True
            instances = _index(row.get("instances"))
            if not isinstance(instances, int):
                self.at_risk = self.at_risk or None
            elif at_risk(verdict, instances, _name(row, "vacuity")):
                self.at_risk = True
        violation = VIOLATED.get(verdict)
        self.own.add(violation)
        if told:
            self.witnesses.append((violation, _witness(row, verdict)))

    def outcome(self) -> Outcome:
        """V = 1 if any assigned rule is violated."""
        violation = (
            True if True in self.own else None if None in self.own or not self.own else False
        )
        return replace(
            self.head,
            violation=violation,
            judged=self.judged,
            at_risk=self.at_risk,
            witnesses=tuple(witness for said, witness in self.witnesses if said == violation),
        )


def _refuse_copies(outcomes: Iterable[Outcome], wanted: Wanted) -> None:
    """Every rollout counts once: raise InputError naming the rows of those that are there twice."""
    seen: dict[tuple[Any, ...], Outcome] = {}
    copies = []
    for o in outcomes:
        key = tuple(getattr(o, name) for name in wanted.same)
        before = seen.setdefault(key if key and None not in key else (o.episode_id,), o)
        if before is not o:
            copies.append((before, o))
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


def _witness(row: Row, verdict: str) -> Witness:
    time = row.get("time")
    return Witness(
        rule=cell_text(row.get("rule")),
        verdict=verdict,
        time=None if is_missing(time) else float(str(time)),
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


def _name(row: Row, column: str) -> str | None:
    value = row.get(column)
    return None if is_missing(value) else sys.intern(str(value))


def _index(value: Any) -> int | str | None:
    """A seed or rollout: a whole number however it is written, otherwise its text."""
    if is_missing(value):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value)
    return int(number) if number.is_integer() else str(value)
