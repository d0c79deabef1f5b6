"""The list that is filtered and sorted: one row per episode and rule, or per rollout."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError
from safestage_eval.metrics import Outcome
from safestage_eval.metrics.read_rows import truth

from .packed import columns

REPEATED = (
    "verdict", "stage", "rule", "task", "policy", "prompt", "signal", "unit", "severity", "phase",
    "follows", "success", "episode", "explanation", "seed", "rollout", "own",
)  # fmt: skip
"""Columns with few values, or values that are long."""

COLUMNS = (
    "episode", "verdict", "own", "success", "stage", "rule", "task", "policy", "prompt", "seed", "rollout",
    "time", "worst", "phase", "signal", "value", "limit", "unit", "margin", "normalised", "severity", "follows",
    "explanation", "intervals", "section",
)  # fmt: skip

Row = Mapping[str, Any]


def of_results(rows: Sequence[Row], drawn: Mapping[str, int]) -> str:
    """List assigned rules' verdicts, and the violations of others; ``drawn``: id → number of its section."""
    table: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    for row in rows:
        verdict = row["verdict"]
        if verdict is None or not (row["assigned"] or verdict == "violation"):
            continue
        name = str(row["episode_id"])
        values_of_row = {
            "episode": name,
            "verdict": verdict,
            "own": bool(row["assigned"]),
            "success": truth(row["success"], name, "success"),
            **{key: _said(row.get(key)) for key in ("stage", "rule", "task", "policy", "prompt")},
            **{key: _whole(row.get(key)) for key in ("seed", "rollout")},
            "time": _number(row.get("time")),
            "worst": _number(row.get("worst_time")),
            **{key: _said(row.get(key)) for key in ("phase", "signal", "unit", "severity")},
            **{key: _number(row.get(key)) for key in ("value", "limit", "margin")},
            "normalised": _number(row.get("margin_normalised")),
            "follows": _said(row.get("consequence_of")),
            "explanation": _said(row.get("explanation")) or "",
            "intervals": _intervals(row.get("intervals"), name) if verdict == "violation" else 0,
            "section": drawn.get(name, -1),
        }
        for key, values in table.items():
            values.append(values_of_row[key])
    return columns(table, REPEATED)


def of_outcomes(outcomes: Sequence[Outcome]) -> str:
    """List the rollouts of a bare table with their outcomes."""
    table: dict[str, list[Any]] = {name: [None] * len(outcomes) for name in COLUMNS}
    said = {True: "violation", False: "pass", None: "inconclusive"}
    table |= {
        "episode": ["" for _ in outcomes],
        "verdict": [said[o.violation] for o in outcomes],
        "own": [True] * len(outcomes),
        "success": [o.success for o in outcomes],
        "stage": [o.stage for o in outcomes],
        "task": [o.task for o in outcomes],
        "policy": [o.policy for o in outcomes],
        "prompt": [o.prompt for o in outcomes],
        "seed": [o.seed for o in outcomes],
        "rollout": [o.rollout for o in outcomes],
        "section": [-1] * len(outcomes),
    }
    return columns(
        {name: values for name, values in table.items() if any(v is not None for v in values)},
        REPEATED,
    )


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
