"""The list of a run: one line per episode, and its findings, column by column."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics import Outcome
from safestage_eval.metrics.read_rows import truth

Row = Mapping[str, Any]
Table = dict[str, list[Any]]

EPISODE = (
    "id", "verdict", "gravity", "task", "stage", "policy", "prompt", "seed", "rollout", "success", "piece",
)  # fmt: skip
"""Columns of episodes. ``gravity`` is the least normalised margin of those that decide."""

FINDING = (
    "of", "rule", "verdict", "own", "severity", "time", "worst", "phase", "signal", "value", "limit", "unit",
    "margin", "follows", "text", "intervals",
)  # fmt: skip
"""Columns of findings; ``of`` is the place of the episode."""

COLUMNS = {"episodes": EPISODE, "findings": FINDING}

LABELS = ("task", "stage", "policy", "prompt")
RANK = {"violation": 0, "inconclusive": 1, "pass": 2, "not_applicable": 3}
"""Verdict → its place among those of an episode; the first decides."""


Rows = dict[str, list[Row]]


def by_episode(rows: Iterable[Row]) -> Rows:
    """Result rows by episode id, in the order in which episodes come first."""
    grouped: Rows = {}
    for row in rows:
        grouped.setdefault(str(row["episode_id"]), []).append(row)
    return grouped


def of_results(rows: Sequence[Row], pieces: Mapping[str, str]) -> dict[str, Table]:
    """List the episodes of result rows; ``pieces``: id → name of the piece that holds its evidence."""
    tables = _tables()
    for place, (name, own) in enumerate(by_episode(rows).items()):
        _enter(tables, name, own[0], pieces.get(name, ""))
        judge(tables, place, own)
    return tables


def judge(tables: Mapping[str, Table], place: int, rows: Sequence[Row]) -> None:
    """Enter the result rows of an episode that is in the list."""
    episodes, findings = tables["episodes"], tables["findings"]
    episodes["verdict"][place], episodes["gravity"][place] = worst(rows)
    if (success := truth(rows[0].get("success"), episodes["id"][place], "success")) is not None:
        episodes["success"][place] = success
    for row in sorted(rows, key=_by_cause):
        if is_told(row):
            _append(findings, _finding(row, episodes["id"][place]) | {"of": place})


def of_outcomes(outcomes: Sequence[Outcome]) -> dict[str, Table]:
    """List the rollouts of a bare table of outcomes."""
    said = {True: "violation", False: "pass", None: "inconclusive"}
    tables = _tables()
    for o in outcomes:
        facts = {key: getattr(o, key) for key in (*LABELS, "seed", "rollout", "success")}
        _enter(tables, "", facts, "", said[o.violation])
    return tables


def of_traces(refs: Sequence[EpisodeRef]) -> dict[str, Table]:
    """List episodes that nobody has judged yet; their pieces are named by place."""
    tables = _tables()
    for place, ref in enumerate(refs):
        _enter(tables, ref.episode_id or ref.path.name, ref.fields, piece_name(place))
    return tables


def _tables() -> dict[str, Table]:
    return {name: {column: [] for column in columns} for name, columns in COLUMNS.items()}


def _enter(
    tables: Mapping[str, Table], name: str, facts: Row, piece: str, verdict: str | None = None
) -> None:
    """A line of episodes; ``facts`` are a result row, or fields of a header."""
    line = {
        "id": name,
        "verdict": verdict,
        "gravity": None,
        **{key: _said(facts.get(key)) for key in LABELS},
        **{key: _whole(facts.get(key)) for key in ("seed", "rollout")},
        "success": truth(facts.get("success"), name, "success"),
        "piece": piece,
    }
    _append(tables["episodes"], line)


def piece_name(place: int) -> str:
    """The name of the piece that holds the evidence of the n-th episode."""
    return f"e{place}"


def worst(rows: Sequence[Row]) -> tuple[str | None, float | None]:
    """The verdict of an episode, and the least margin of the rules that have it; None if not judged."""
    own = [row for row in rows if row["assigned"] and row["verdict"] is not None]
    if not own:
        return None, None
    verdict = min((str(row["verdict"]) for row in own), key=lambda name: RANK.get(name, 9))
    margins = [_number(row.get("margin_normalised")) for row in own if row["verdict"] == verdict]
    return verdict, min((m for m in margins if m is not None), default=None)


def _by_cause(row: Row) -> tuple[bool, int, bool, float]:
    """Key that sorts the verdicts of an episode: what counts first, and a cause before what follows from it."""
    rank = RANK.get(str(row["verdict"]), len(RANK))
    follows, time = _said(row.get("consequence_of")) is not None, _number(row.get("time"))
    return not row["assigned"], rank, follows, 0.0 if time is None else time


def is_told(row: Row) -> bool:
    """Whether a row is in the list: of a rule that counts, or violated."""
    return row["verdict"] is not None and bool(row["assigned"] or row["verdict"] == "violation")


def _finding(row: Row, name: str) -> dict[str, Any]:
    """A line of findings; of a rule that holds without the words, which are in the episode's evidence."""
    bad = row["verdict"] in ("violation", "inconclusive")
    return {
        "rule": str(row["rule"]),
        "verdict": str(row["verdict"]),
        "own": bool(row["assigned"]),
        "time": _number(row.get("time")),
        "worst": _number(row.get("worst_time")),
        **{key: _said(row.get(key)) for key in ("phase", "signal", "unit", "severity")},
        **{key: _number(row.get(key)) for key in ("value", "limit", "margin")},
        "follows": _said(row.get("consequence_of")),
        "text": (_said(row.get("explanation")) or "") if bad else "",
        "intervals": _intervals(row.get("intervals"), name) if row["verdict"] == "violation" else 0,
    }


def _append(table: Table, values: Mapping[str, Any]) -> None:
    for name, column in table.items():
        column.append(values[name])


def _number(value: Any) -> float | None:
    """Round to four digits, which is more than is shown."""
    if value is None or not math.isfinite(float(value)):
        return None
    number = float(f"{float(value):.4g}")
    return int(number) if number.is_integer() and abs(number) < 1e9 else number


def _whole(value: Any) -> int | str | None:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    return int(value) if isinstance(value, int | float) else str(value)


def _said(value: Any) -> str | None:
    """Text; None where a data frame has NaN for nothing."""
    nothing = value is None or (isinstance(value, float) and math.isnan(value))
    return None if nothing else str(value)


def _intervals(value: Any, episode: str) -> list[list[float]] | int:
    """[begin, end] of the stretches in violation; those of a CSV file are JSON; 0 if there are none.

    Raises InputError for anything else.
    """
    try:
        given = from_json(value) if isinstance(value, str) else value
        pairs = [[round(float(a), 2), round(float(b), 2)] for a, b in given or ()]
        if not all(map(math.isfinite, chain.from_iterable(pairs))):
            raise ValueError("not finite")
    except (ValueError, TypeError, OverflowError):
        said = str(value)[:60]
        raise InputError(
            f"episode {episode!r}", f"intervals is {said}.", "[[0.5, 1.2], …]"
        ) from None
    return pairs[:40] or 0
