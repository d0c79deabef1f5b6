"""Outcomes from rows: those that ``safestage score`` writes, and bare outcome tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError

from .outcome import OPEN, Outcome
from .read_rows import read_rows, truth

Row = Mapping[str, Any]

BARE = ("task", "stage", "policy", "prompt", "seed", "rollout", "success", "violation")
"""Columns of an outcome table; ``family`` may be there as well."""

RESULT = ("episode_id", "rule", "assigned", "verdict", "success")
"""Columns by which rows are known as results of ``safestage score``."""

ALLOWED = (
    f"results of safestage score, or a table with the columns {', '.join(BARE)} "
    "and, if there are any, family"
)

NOT_LOADED = "not_loaded"
"""``vacuity`` of the row of an assigned rule that was not loaded: it has no verdict."""

_STAGES = ("ISH", "ETS", "FSH")
_VERDICTS = {"pass": False, "not_applicable": False, "violation": True, "inconclusive": None}


def read_outcomes(
    paths: Sequence[str | Path], label: str | None = None
) -> dict[str, list[Outcome]]:
    """The outcomes in one or more files, and every one of them once.

    Args:
        paths: files of any of our formats.
        label: a column that tells several sets of outcomes in one file apart.

    Returns:
        Value of the column → outcomes; without a label all under ``""``.

    Raises:
        InputError: a file cannot be read, lacks a column, or an outcome is there twice.
    """
    found: dict[str, list[Outcome]] = {}
    columns = {*BARE, *RESULT, "vacuity", "family", *([label] if label else [])}
    for path in paths:
        if Path(path).is_dir():
            raise InputError(str(path), "is a folder.", ALLOWED, "name the files in it")
        rows = read_rows(path, columns, ALLOWED)
        if label is None:
            found.setdefault("", []).extend(outcomes_of(rows, str(path)))
            continue
        groups: dict[str, list[tuple[int, Row]]] = {}
        for number, row in enumerate(rows, 1):
            if row.get(label) is None:
                raise InputError(f"{path}, row {number}", f"lacks {label}.")
            groups.setdefault(str(row[label]), []).append((number, row))
        for name, part in groups.items():
            found.setdefault(name, []).extend(_of_numbered(part, str(path)))
    for group in found.values():
        _refuse_copies(group)
    return found


def outcomes_of(rows: Iterable[Row], where: str = "") -> list[Outcome]:
    """The outcomes that rows tell of; what a result's header leaves open is shown as ``–``.

    Args:
        rows: one per episode and rule, as ``safestage score`` writes them, or one per episode.
        where: the file, for messages.

    Raises:
        InputError: a row lacks a column or says something that cannot be.
    """
    return _of_numbered(list(enumerate(rows, 1)), where)


def _of_numbered(rows: Sequence[tuple[int, Row]], file: str) -> list[Outcome]:
    if not rows:
        return []
    if "verdict" in rows[0][1] or "rule" in rows[0][1]:
        return _of_results(rows, file)
    return [_bare(row, _place(file, number)) for number, row in rows]


def _bare(row: Row, where: str) -> Outcome:
    _need(row, BARE, where)
    success, violation = (truth(row[name], where, name) for name in ("success", "violation"))
    empty = [name for name in BARE[:6] if _missing(row[name])]
    if empty:
        raise InputError(where, f"nothing is said of {', '.join(empty)}.")
    stage = str(row["stage"]).strip().upper()
    if stage not in _STAGES:
        raise InputError(where, f"stage is {row['stage']!r}.", ", ".join(_STAGES))
    family = row.get("family")
    return Outcome(
        policy=str(row["policy"]),
        prompt=str(row["prompt"]),
        stage=stage,
        success=success,
        violation=violation,
        judged=True,
        task=str(row["task"]),
        family=None if _missing(family) else str(family),
        seed=_index(row["seed"]),
        rollout=_index(row["rollout"]),
        where=where,
    )


def _of_results(rows: Sequence[tuple[int, Row]], file: str) -> list[Outcome]:
    episodes: dict[str, list[tuple[int, Row]]] = {}
    for number, row in rows:
        _need(row, RESULT, _place(file, number))
        episodes.setdefault(str(row["episode_id"]), []).append((number, row))
    return [_episode(name, group, file) for name, group in episodes.items()]


def _episode(name: str, rows: Sequence[tuple[int, Row]], file: str) -> Outcome:
    first, head = rows[0]
    seen: dict[str, int] = {}
    own: list[bool | None] = []
    absent = False
    for number, row in rows:
        where, rule, verdict = _place(file, number), str(row["rule"]), row["verdict"]
        if seen.setdefault(rule, number) != number:
            raise InputError(
                f"{file}, rows {seen[rule]} and {number}",
                f"two verdicts of {rule} on the episode {name!r}.",
                fix="keep the results of one scoring in one file",
            )
        if verdict is None:  # a cost without a budget decides nothing
            absent = absent or row.get("vacuity") == NOT_LOADED
            continue
        if verdict not in _VERDICTS:
            raise InputError(where, f"verdict is {verdict!r}.", ", ".join(_VERDICTS))
        if truth(row["assigned"], where, "assigned"):
            own.append(_VERDICTS[verdict])
    return Outcome(
        policy=_name(head, "policy") or OPEN,
        prompt=_name(head, "prompt") or OPEN,
        stage=_name(head, "stage") or OPEN,
        success=truth(head["success"], _place(file, first), "success"),
        violation=True if True in own else None if absent or not own or None in own else False,
        judged=bool(own) and (True in own or not absent),
        task=_name(head, "task"),
        family=_name(head, "family"),
        seed=_index(head.get("seed")),
        rollout=_index(head.get("rollout")),
        episode_id=name,
        where=_place(file, first),
    )


def _refuse_copies(outcomes: Iterable[Outcome]) -> None:
    """Every rollout counts once: raise InputError naming the rows of those that are there twice."""
    seen: dict[tuple[Any, ...], Outcome] = {}
    copies = []
    for o in outcomes:
        key: tuple[Any, ...] = (o.task, o.policy, o.prompt, o.seed, o.rollout)
        if None in key:
            key = (o.episode_id,)
        if seen.setdefault(key, o) is not o:
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


def _place(file: str, number: int) -> str:
    return f"{file}, row {number}" if file else f"row {number}"


def _need(row: Row, columns: Iterable[str], where: str) -> None:
    missing = [name for name in columns if name not in row]
    if missing:
        raise InputError(where, f"lacks {', '.join(missing)}.", ALLOWED)


def _name(row: Row, column: str) -> str | None:
    value = row.get(column)
    return None if _missing(value) else str(value)


def _missing(value: Any) -> bool:
    return value is None or value == "" or (isinstance(value, float) and math.isnan(value))


def _index(value: Any) -> int | str | None:
    """A seed or rollout: a whole number however it is written, otherwise its text."""
    if _missing(value):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value)
    return int(number) if number.is_integer() else str(value)
