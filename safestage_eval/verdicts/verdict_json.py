"""Verdicts and results as JSON values, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from .verdict import CostTotal, EpisodeResult, Verdict

T = TypeVar("T", Verdict, CostTotal, EpisodeResult)

_TUPLES = {
    kind: [field.name for field in fields(kind) if str(field.type).startswith("tuple")]
    for kind in (Verdict, CostTotal, EpisodeResult)
}


def to_json(result: Verdict | EpisodeResult) -> dict[str, Any]:
    """JSON values of a verdict or a result."""
    out = dict(vars(result))
    if isinstance(result, EpisodeResult):
        out["verdicts"] = [vars(verdict) for verdict in result.verdicts]
        out["costs"] = [vars(cost) for cost in result.costs]
    return out


def verdict_from_json(stored: Mapping[str, Any]) -> Verdict:
    """A verdict from JSON."""
    return _made(Verdict, stored)


def result_from_json(stored: Mapping[str, Any], path: str) -> EpisodeResult:
    """A result from JSON; ``path`` is where the episode was found this time."""
    made = dict(stored)
    made["verdicts"] = [verdict_from_json(item) for item in stored["verdicts"]]
    made["costs"] = [_made(CostTotal, item) for item in stored["costs"]]
    made["path"] = path
    return _made(EpisodeResult, made)


def _made(kind: type[T], stored: Mapping[str, Any]) -> T:
    given = dict(stored)
    for name in _TUPLES[kind]:
        items = given.get(name, ())
        given[name] = tuple(map(tuple, items)) if items and type(items[0]) is list else tuple(items)
    return kind(**given)
