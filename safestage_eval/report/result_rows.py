"""Results as rows and as one JSON object, and both as text: what every machine-readable format is made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, get_args

from safestage_eval._text.json_out import to_json
from safestage_eval.metrics import metrics, outcomes
from safestage_eval.run.scores import Scores
from safestage_eval.verdicts.verdict import VerdictName
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
        "metrics": rates_of(scores),
        "problems": [{"path": p.path, "message": p.message} for p in scores.problems],
        **({"sample": scores.sample} if scores.sample else {}),
        **({"audit": dict(scores.audit)} if scores.audit is not None else {}),
    }


def rates_of(scores: Scores) -> dict[str, Any]:
    """The rates, and how each rule that counts fared."""
    every = outcomes(scores.results, scores.set_aside)
    return {
        **metrics(every, len(scores.problems)),
        "by_rule": by_rule_rows(scores),
    }


def by_rule_rows(scores: Scores) -> list[dict[str, Any]]:
    """How each rule that counts fared: episodes by verdict, why it is open, whether it decides."""
    return [
        {
            "rule": c.rule,
            "title": c.title,
            **{name: c[name] for name in get_args(VerdictName)},
            "cause": c.cause or None,
            "remedy": c.remedy or None,
            "set_aside": c.set_aside,
        }
        for c in scores.by_rule
    ]


_EPISODES = ' "episodes": []'


def json_pieces(scores: Scores) -> Iterator[str]:
    """The text of ``document``, the rows one by one."""
    around = document(replace(scores, results=()))
    around["metrics"] = rates_of(scores)
    before, after = to_json(around, 1).split(_EPISODES, 1)
    yield before + _EPISODES[:-1]
    separator = "\n"
    for row in each_row(scores):
        yield separator + "  " + to_json(row, 1).replace("\n", "\n  ")
        separator = ",\n"
    yield ("\n ]" if separator != "\n" else "]") + after + "\n"


def json_lines(scores: Scores) -> Iterator[str]:
    """One row per line."""
    for row in each_row(scores):
        yield to_json(row) + "\n"
