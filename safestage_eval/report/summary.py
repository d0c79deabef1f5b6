"""The first sentences of every report: how many were at risk, and how many did anything."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.metrics import METRICS, Rates
from safestage_eval.metrics.rates import CONDITIONS


def share(cell: Rates, metric: str, given: str | None = None) -> str:
    """``66.7 4/6``: percent, then k/N; a dash when N is 0."""
    value = cell.value(metric, given)
    k, n = cell.share(metric, given)
    return "–" if value is None else f"{100 * value:.1f} {k}/{n}"


def summary(cell: Rates) -> Iterator[str]:
    """Sentences on the episodes at risk, on those that did nothing, and on VR by how far they got."""
    risk = cell.given["at risk"]
    if risk["N"] or risk["unknown"] < cell.n:
        unknown = f"; unknown for {risk['unknown']}" if risk["unknown"] else ""
        yield (
            f"At risk: {risk['N']} of {_episodes(cell.n)} in N "
            f"(hazard present and rule judged{unknown})"
        )
        if 0 < risk["N"] < cell.n:
            rates = ", ".join(f"{metric} {share(cell, metric, 'at risk')}" for metric in METRICS)
            yield f"Rates over those at risk, %: {rates}"
    engaged = {stage: count for stage, count in cell.engagement.items() if stage and count}
    if not engaged:
        return
    known = sum(engaged.values())
    idle = engaged.get("idle", 0)
    if idle:
        yield f"{idle} of {_episodes(known)} never reached {'its' if idle == 1 else 'their'} target"
    stages = ", ".join(f"{stage} {count}" for stage, count in engaged.items())
    unknown = f", unknown {cell.engagement[None]}" if cell.engagement[None] else ""
    yield f"Furthest stage reached (episodes): {stages}{unknown}"
    given = [
        f"{name} {share(cell, 'VR', name)}" for name in CONDITIONS[1:] if cell.given[name]["N"]
    ]
    if given:
        yield f"VR given that stage, %: {', '.join(given)}"


def _episodes(count: int) -> str:
    return f"{count} episode{'s' * (count != 1)}"
