"""The first lines of every report: how many were judged and at risk, and how many did anything."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from safestage_eval._text.plural import count
from safestage_eval.metrics import METRICS, Rates
from safestage_eval.metrics.rates import CONDITIONS


def share(cell: Rates, metric: str, given: str | None = None) -> str:
    """``66.7 4/6``: percent, then k/N; a dash when N is 0."""
    value = cell.value(metric, given)
    k, n = cell.share(metric, given)
    return "–" if value is None else f"{100 * value:.1f} {k}/{n}"


def coverage(cell: Rates, unreadable: int = 0) -> str:
    """``Judged 2 of 17 episodes; at risk 2; inconclusive 15``: what the rates rest on.

    ``unreadable``: episodes that could not be read, or whose recording failed.
    """
    parts = [f"Judged {cell.n} of {count(cell.episodes + unreadable, 'episode')}"]
    risk = cell.given["at risk"]
    if risk["N"] or risk["unknown"] < cell.n:
        unknown = f" (unknown of {risk['unknown']})" if risk["unknown"] else ""
        parts.append(f"at risk {risk['N']}{unknown}")
    counts = {
        "inconclusive": cell.inconclusive,
        "no rule assigned or loaded": cell.not_judged,
        "not readable": unreadable,
    }
    return "; ".join([*parts, *(f"{name} {number}" for name, number in counts.items() if number)])


def judged(cells: Iterable[Rates]) -> dict[str, Callable[[Rates], str]]:
    """A column with k/n, judged of all, for a table of rates; none where all were judged."""
    if all(cell.n == cell.episodes for cell in cells):
        return {}
    return {"judged": lambda cell: f"{cell.n}/{cell.episodes}"}


def summary(cell: Rates) -> Iterator[str]:
    """Sentences on the rates of those at risk, on who did nothing, and on VR by how far they got."""
    risk = cell.given["at risk"]
    if 0 < risk["N"] < cell.n:
        rates = ", ".join(f"{metric} {share(cell, metric, 'at risk')}" for metric in METRICS)
        yield f"Rates over those at risk, %: {rates}"
    engaged = {stage: n for stage, n in cell.engagement.items() if stage and n}
    if not engaged:
        return
    total = sum(engaged.values())
    idle = engaged.get("idle", 0)
    if idle:
        yield f"{idle} of {count(total, 'episode')} never reached {'its' if idle == 1 else 'their'} target"
    stages = ", ".join(f"{stage} {n}" for stage, n in engaged.items())
    unknown = f", unknown {cell.engagement[None]}" if cell.engagement[None] else ""
    yield f"Furthest stage reached (episodes): {stages}{unknown}"
    given = [
        f"{name} {share(cell, 'VR', name)}" for name in CONDITIONS[1:] if cell.given[name]["N"]
    ]
    if given:
        yield f"VR given that stage, %: {', '.join(given)}"
