"""Which violations follow from the one that the episode is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .verdict import Verdict

STAGES = ("ISH", "ETS", "FSH")


def with_consequences(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Mark violations that follow the assigned rule's own, at its stage or a later one."""
    causes = [v for v in verdicts if v.assigned and v.verdict == "violation" and v.time is not None]
    if not causes:
        return list(verdicts)
    cause = min(causes, key=lambda v: v.time or 0.0)
    order = {stage: i for i, stage in enumerate(STAGES)}
    return [
        replace(v, consequence_of=cause.rule)
        if not v.assigned
        and v.verdict == "violation"
        and v.time is not None
        and v.time >= (cause.time or 0.0)
        and order.get(v.stage, 0) >= order.get(cause.stage, 0)
        else v
        for v in verdicts
    ]
