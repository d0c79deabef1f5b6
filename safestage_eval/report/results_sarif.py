"""Results as SARIF: a result for each violation, and each verdict that counts and is open."""

from __future__ import annotations

import math
from collections.abc import Iterator

from safestage_eval.run.scores import Scores

from .render_sarif import Help, Level, Mark, render_sarif

MILD = ("minor", "mild", "light", "low", "slight")
"""Levels of severity, as rule files name them, that are warnings; a violation of any other is an error."""


def render(scores: Scores) -> str:
    """The document."""
    helps = {
        code: Help(title, scores.reasons.get(code, "")) for code, title in scores.rules.items()
    }
    return render_sarif(_marks(scores), helps, [(p.path, p.message) for p in scores.problems])


def _marks(scores: Scores) -> Iterator[Mark]:
    for result in scores.results:
        for v in scores.gates.counted(result):
            if v.verdict not in ("violation", "inconclusive"):
                continue
            mild = v.verdict == "inconclusive" or v.severity in MILD
            level: Level = "warning" if mild else "error"
            facts = {
                "verdict": v.verdict, "severity": v.severity, "time": v.time, "value": v.value,
                "ruleDigest": v.rule_digest, "traceHash": result.trace_hash,
            }  # fmt: skip
            finite = {
                name: fact
                for name, fact in facts.items()
                if not isinstance(fact, float) or math.isfinite(fact)
            }
            message = v.explanation or "; ".join(v.notes) or v.title
            yield Mark(v.rule, level, message, result.path, result.episode_id, finite)
        for rule in result.not_loaded:
            message = "it is assigned and was not loaded"
            yield Mark(rule, "warning", message, result.path, result.episode_id)
