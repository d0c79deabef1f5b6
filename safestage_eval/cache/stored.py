"""Verdicts and results as JSON, partly measured signals as values of an entry, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from safestage_eval.relations.partial import Partial
from safestage_eval.verdicts import EpisodeResult, Verdict
from safestage_eval.verdicts.verdict import CostTotal

from .entry import Value

T = TypeVar("T", Verdict, CostTotal, EpisodeResult)

_TUPLES = {
    kind: [field.name for field in fields(kind) if str(field.type).startswith("tuple")]
    for kind in (Verdict, CostTotal, EpisodeResult)
}


def plain(found: Verdict | EpisodeResult) -> dict[str, Any]:
    """JSON values of a verdict or a result."""
    out = dict(vars(found))
    if isinstance(found, EpisodeResult):
        out["verdicts"] = [vars(verdict) for verdict in found.verdicts]
        out["costs"] = [vars(cost) for cost in found.costs]
    return out


def verdict(stored: Mapping[str, Any]) -> Verdict:
    """A verdict from JSON."""
    return _made(Verdict, stored)


def result(stored: Mapping[str, Any], path: str) -> EpisodeResult:
    """A result from JSON; ``path`` is where the episode was found this time."""
    made = dict(stored)
    made["verdicts"] = [verdict(item) for item in stored["verdicts"]]
    made["costs"] = [_made(CostTotal, item) for item in stored["costs"]]
    made["path"] = path
    return _made(EpisodeResult, made)


def _made(kind: type[T], stored: Mapping[str, Any]) -> T:
    given = dict(stored)
    for name in _TUPLES[kind]:
        items = given[name]
        given[name] = tuple(map(tuple, items)) if items and type(items[0]) is list else tuple(items)
    return kind(**given)


def kept_partial(partial: Partial) -> Value:
    """A signal that was measured at some frames, as it is kept."""
    about = {f"about {i}": mask for i, mask in enumerate(partial.notes.values())}
    return {
        "lower": partial.lower,
        "upper": partial.upper,
        "done": partial.done,
        "notes": list(partial.notes),
        **about,
    }


def partial_of(kept: Value) -> Partial:
    """The signal of ``kept_partial``, which may be measured further."""
    lower, upper, done = (np.array(kept[part]) for part in ("lower", "upper", "done"))
    about = {note: np.array(kept[f"about {i}"]) for i, note in enumerate(kept["notes"])}
    return Partial(lower, upper, done, about)
