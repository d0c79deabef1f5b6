"""Results as rows and as one JSON object: what every machine-readable format is made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from safestage_eval.metrics import metrics, outcomes
from safestage_eval.run.scores import Scores
from safestage_eval.version import __version__

COLUMNS = (
    "episode_id", "path", "task", "stage", "family", "policy", "prompt", "seed", "rollout",
    "success", "success_time", "engagement", "rule", "assigned", "verdict", "violation", "time", "worst_time",
    "phase", "signal", "value", "limit", "unit", "margin", "margin_normalised", "bodies",
    "intervals", "exposure_time", "raw_intervals", "undersampled", "vacuity", "instances", "violated_instances", "breaches", "breaches_by_level", "severity", "consequence_of",
    "explanation", "notes", "sources", "rule_digest", "trace_hash", "version",
)  # fmt: skip
"""Names of the columns of a result row, in order (docs/results.md)."""


KINDS = {
    **dict.fromkeys(("seed", "rollout", "instances", "violated_instances", "breaches"), "integer"),
    **dict.fromkeys(("success", "assigned", "violation", "undersampled"), "boolean"),
    **dict.fromkeys(
        ("success_time", "time", "worst_time", "value", "limit", "margin", "margin_normalised",
         "exposure_time"), "number",
    ),
    **dict.fromkeys(("bodies", "breaches_by_level", "notes", "sources"), "strings"),
    **dict.fromkeys(("intervals", "raw_intervals"), "pairs"),
}  # fmt: skip
"""Types of the columns that are not text: ``pairs`` are lists of two numbers."""

MEASURED = tuple(name for name, kind in KINDS.items() if kind == "number")


def rows(scores: Scores) -> list[dict[str, Any]]:
    """One row per episode and rule."""
    return list(each_row(scores))


def each_row(scores: Scores) -> Iterator[dict[str, Any]]:
    """Yield the rows of ``rows`` one by one."""
    for result in scores.results:
        for row in result.rows():
            for name in MEASURED:  # infinite or NaN: JSON has no such numbers, rows leave them open
                value = row[name]
                if value is not None and not math.isfinite(value):
                    row[name] = None
            yield row


def document(scores: Scores) -> dict[str, Any]:
    """Everything as one object: version, rules, episodes, metrics, problems, and what sample it is."""
    return {
        "version": __version__,
        "rules": dict(scores.rules),
        "episodes": rows(scores),
        "metrics": metrics(outcomes(scores.results)),
        "problems": [{"path": p.path, "message": p.message} for p in scores.problems],
        **({"sample": scores.sample} if scores.sample else {}),
        **({"audit": dict(scores.audit)} if scores.audit is not None else {}),
    }
