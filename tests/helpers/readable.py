"""Laws of the sentence of every verdict."""

from __future__ import annotations

import re

from safestage_eval.verdicts import Verdict


def assert_readable(verdict: Verdict) -> None:
    """Every verdict has a sentence, and one that a measurement decides has value, limit and unit."""
    text = verdict.explanation
    assert re.fullmatch(r"[^{}–]*[a-z][^{}–]*\.", text), (verdict.rule, text)
    assert not re.search(r"\bNone\b|at never|from never", text), (verdict.rule, text)
    if verdict.verdict == "pass" and verdict.margin is not None and verdict.dimension != "time":
        assert re.search(r"(required|allowed|would be one)\.$", text), (verdict.rule, text)
        assert len(re.findall(r"\d (?:cm|mm|N|deg|rad/s|cm/s)\b", text)) >= 2, (verdict.rule, text)
