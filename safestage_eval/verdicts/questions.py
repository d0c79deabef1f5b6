"""Questions about an episode that name all their answers depend on, for stores that keep answers."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.rules import syntax as ast
from safestage_eval.states.scope import Scope

from .verdict import Verdict

Stretch = tuple[Scope, int | None]


def short(text: str) -> str:
    """32 hexadecimal digits that stand for a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def rule_wording(rules: ast.RuleSet, rule: ast.Rule) -> str:
    """A digest of a rule with all its wording, but without the definitions that it names."""
    digest: str | None = rules.known.get(("said", rule.code))
    if digest is None:
        digest = rules.known["said", rule.code] = short(repr(rule))
    return digest


def verdict_question(
    rules: ast.RuleSet,
    rule: ast.Rule,
    blank: Verdict,
    players: Mapping[str, Sequence[str]],
    success: str,
) -> str:
    """Everything that a verdict depends on besides the trace, for ``Store.answer``."""
    start = blank.assigned, blank.sources, blank.rule_digest
    return f"verdict {rule_wording(rules, rule)} {start} {sorted(players.items())} {success}"


def stretches_to_json(stretches: list[Stretch]) -> list[Any]:
    """JSON of stretches of frames; which frames are certain as the runs of these."""
    out: list[Any] = []
    for (first, stop, cut, sure), end in stretches:
        certain = None if sure is None else [[int(a), int(b)] for a, b in runs(sure)]
        out.append([int(first), int(stop), bool(cut), certain, end])
    return out


def stretches_from_json(stored: list[Any]) -> list[Stretch]:
    """Stretches of frames from JSON."""
    out: list[Stretch] = []
    for first, stop, cut, certain, end in stored:
        sure = None
        if certain is not None:
            sure = np.zeros(stop - first, np.bool_)
            for a, b in certain:
                sure[a:b] = True
        out.append((Scope(first, stop, cut, sure), end))
    return out
