"""The evaluator's verdicts on episodes, read from result rows or from a table with the same columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError

from .agreement import Judged, Witness
from .outcome import OPEN
from .outcome_rows import NOT_LOADED, VIOLATED
from .read_rows import cell_text, demand_columns, read_rows, truth

Row = Mapping[str, Any]

BARE = ("episode_id", "stage", "violation")
RESULT = ("episode_id", "stage", "rule", "assigned", "verdict")
WITNESS = ("time", "bodies", "explanation")
"""Columns of a witness; any of them may be missing."""
ALLOWED = f"results of safestage score, or a table with the columns {', '.join(BARE)}"


def read_judged(paths: Sequence[str | Path]) -> list[Judged]:
    """Read each episode's verdict from files in any of our formats.

    Raises:
        InputError: a file cannot be read or lacks a column, or an episode is in several files, or
            twice in a table without rules.
    """
    judged: dict[str, tuple[str, Judged]] = {}
    for path in paths:
        rows = read_rows(path, {*BARE, *RESULT, *WITNESS, "vacuity"}, ALLOWED)
        for one in _judged_of(rows, str(path)):
            before = judged.setdefault(one.episode_id, (str(path), one))
            if before[1] is not one:
                raise InputError(
                    f"{before[0]} and {path}", f"both tell of the episode {one.episode_id!r}.",
                    fix="name results of one scoring",
                )  # fmt: skip
    return [one for _, one in judged.values()]


def _judged_of(rows: Sequence[Row], where: str) -> list[Judged]:
    """Read verdicts from rows: several per episode with ``rule`` and ``verdict``, or one with ``violation``.

    V is as in the tables: any assigned rule violated; unknown if none was, and one is inconclusive.
    An episode without an assigned rule is not decided. ``where``: the file, for messages.
    """
    if not rows:
        return []
    with_rules = "rule" in rows[0] and "verdict" in rows[0]
    episodes: dict[str, list[tuple[str, Row]]] = {}
    for number, row in enumerate(rows, 1):
        place = f"{where}, row {number}"
        demand_columns(row, RESULT if with_rules else BARE, place, ALLOWED)
        name = cell_text(row["episode_id"])
        if not name:
            raise InputError(place, "names no episode.")
        episodes.setdefault(name, []).append((place, row))
    make = _of_rules if with_rules else _bare
    return [make(name, group) for name, group in episodes.items()]


def _bare(name: str, rows: Sequence[tuple[str, Row]]) -> Judged:
    if len(rows) > 1:
        raise InputError(
            f"{rows[0][0]} and {rows[1][0].rpartition(', ')[2]}",
            f"the episode {name!r} is there twice.", fix="keep one row of each",
        )  # fmt: skip
    place, row = rows[0]
    violation = truth(row["violation"], place, "violation")
    witnesses = (_witness(row, ""),) if violation and any(row.get(x) for x in WITNESS) else ()
    return Judged(name, cell_text(row["stage"]) or OPEN, violation, witnesses)


def _of_rules(name: str, rows: Sequence[tuple[str, Row]]) -> Judged:
    own: list[tuple[bool | None, Witness]] = []
    for place, row in rows:
        verdict = row["verdict"]
        if verdict is None or not truth(row["assigned"], place, "assigned"):
            if row.get("vacuity") == NOT_LOADED:
                own.append((None, _witness(row, NOT_LOADED)))
            continue  # otherwise of a cost without a budget, or of another task's rule
        if verdict not in VIOLATED:
            raise InputError(place, f"verdict is {verdict!r}.", ", ".join(VIOLATED))
        own.append((VIOLATED[verdict], _witness(row, str(verdict))))
    said = [violation for violation, _ in own]
    violation = True if True in said else None if not own or None in said else False
    witnesses = tuple(witness for own_violation, witness in own if own_violation == violation)
    return Judged(name, cell_text(rows[0][1]["stage"]) or OPEN, violation, witnesses)


def _witness(row: Row, verdict: str) -> Witness:
    time = row.get("time")
    return Witness(
        rule=cell_text(row.get("rule")),
        verdict=verdict,
        time=None if time is None or cell_text(time) == "" else float(time),
        bodies=_names(row.get("bodies")),
        explanation=cell_text(row.get("explanation")),
    )


def _names(value: Any) -> tuple[str, ...]:
    """Bodies as a list, or as text: JSON, or names with commas or semicolons between."""
    if value is None:
        return ()
    if isinstance(value, str):
        try:
            value = from_json(value)
        except ValueError:
            value = [part.strip() for part in value.replace(";", ",").split(",")]
    names: Iterable[Any] = value if isinstance(value, list | tuple) else [value]
    return tuple(str(name) for name in names if str(name))
