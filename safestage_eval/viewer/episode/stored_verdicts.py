"""Stored results of an episode, and where judging it again disagrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from safestage_eval.verdicts import Verdict

StoredVerdicts = Mapping[str, tuple[str, str]]
"""Code → (verdict, rule digest) of the assigned rules of an episode."""


def stored_verdicts(rows: Sequence[Mapping[str, Any]]) -> StoredVerdicts:
    """Read the rows of one episode."""
    return {
        str(row["rule"]): (str(row["verdict"]), str(row.get("rule_digest") or ""))
        for row in rows
        if row["assigned"] and row["verdict"] is not None
    }


def differences(verdicts: Sequence[Verdict], said: StoredVerdicts) -> tuple[str, ...]:
    """List where results and the rules used here disagree; always shown."""
    sentences = []
    for v in verdicts:
        verdict, digest = said.get(v.rule, ("", ""))
        if verdict and verdict != v.verdict:
            sentences.append(
                f"The results say {verdict.replace('_', ' ')} of {v.rule}; the rules used for this "
                f"page say {v.verdict.replace('_', ' ')}."
            )
        elif digest and digest != v.rule_digest:
            sentences.append(f"The results were made under another meaning of {v.rule}.")
    return tuple(sentences)
