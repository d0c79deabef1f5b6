"""Results as one JSON object, or as one JSON object per line and row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from safestage_eval._text.json_out import to_json
from safestage_eval.run.scores import Scores

from .result_rows import document, each_row, rates_of

_EPISODES = ' "episodes": []'


def pieces(scores: Scores) -> Iterator[str]:
    """``{"version", "rules", "episodes", "metrics", "problems"}``, the rows one by one."""
    around = document(replace(scores, results=()))
    around["metrics"] = rates_of(scores)
    before, after = _json(around).split(_EPISODES, 1)
    yield before + _EPISODES[:-1]
    separator = "\n"
    for row in each_row(scores):
        yield separator + "  " + _json(row).replace("\n", "\n  ")
        separator = ",\n"
    yield ("\n ]" if separator != "\n" else "]") + after + "\n"


def lines(scores: Scores) -> Iterator[str]:
    """One row per line."""
    for row in each_row(scores):
        yield to_json(row) + "\n"


def _json(value: Any) -> str:
    return to_json(value, 1)
