"""The first and the last lines of every report: rates over every episode, as intervals where something is open."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping

from safestage_eval._text.plural import count
from safestage_eval.metrics import METRICS, Rates
from safestage_eval.metrics.rates import CONDITIONS
from safestage_eval.verdicts import Verdict

from .table import Table


def share(cell: Rates, metric: str, given: str | None = None) -> str:
    """``66.7 4/6``: percent, then k/N of the decided ones; a dash when N is 0."""
    value = cell.value(metric, given)
    k, n = cell.share(metric, given)
    return "–" if value is None else f"{100 * value:.1f} {k}/{n}"


def open_share(cell: Rates, metric: str) -> str:
    """``20–100``: percent of all judged episodes; one number where both ends agree to the digit shown."""
    bounds = cell.bounds(metric)
    if bounds is None:
        return "–"
    return _span(*bounds)


def rate_table(cells: Mapping[tuple[str, ...], Rates]) -> Table:
    """A row for each policy, prompt and stage: the rates over all of its judged episodes."""
    head = ("policy", "prompt", "stage", "episodes", *(f"{metric} %" for metric in METRICS))
    rows = [
        [*names, str(cell.n + cell.inconclusive), *(open_share(cell, name) for name in METRICS)]
        for names, cell in cells.items()
    ]
    return Table("", head, rows, 3, grouped=True)


def percent_between(low: float | None, high: float | None) -> str:
    """``20–100 %`` of two shares, 0…1."""
    return "–" if low is None or high is None else f"{_span(low, high)} %"


def _span(*bounds: float) -> str:
    low, high = (f"{100 * bound:.1f}".removesuffix(".0") for bound in bounds)
    return low if low == high else f"{low}–{high}"


def headline(cell: Rates, unreadable: int = 0) -> Iterator[str]:
    """``VR 20–100 % (4 of 20 violated, 16 undecided)``, then the other rates, over every recorded episode.

    ``unreadable``: episodes that could not be read: they count, and any rate may be theirs.
    """
    whole = cell.with_open(unreadable)
    total = whole.n + whole.inconclusive
    if not total:
        yield f"No rates: {coverage(cell)}"
        return
    violated = cell.counts["VR"] + cell.surely["VR"]
    undecided = cell.maybe["VR"] - cell.surely["VR"]
    parts = [f"{violated} of {total} violated"]
    parts += [f"{undecided} undecided"] if undecided else []
    parts += [f"{unreadable} not readable"] if unreadable else []
    yield f"VR {open_share(whole, 'VR')} % ({', '.join(parts)})"
    others = ", ".join(f"{name} {open_share(whole, name)} %" for name in METRICS if name != "VR")
    risk = cell.given["at risk"]
    met = f"; {risk['N']} met the hazard" if risk["N"] or risk["unknown"] < cell.n else ""
    yield f"{others} of {count(total, 'episode')}{met}"


def unsafe_successes(cell: Rates) -> list[str]:
    """``6 of 12 successes were unsafe``, ``4 safe``, ``2 never met the hazard``: what became of the successes.

    Where a rule had nothing to judge, that is no safety.
    """
    if not cell.n + cell.inconclusive:
        return []
    successes, unsafe, safe = (cell.counts[m] + cell.surely[m] for m in ("SR", "USR", "SSR"))
    some = count(successes, "success")
    if successes != 1:
        some = f"{successes} successes"
    parts = [
        f"{unsafe} of {some} {'was' if 1 in (unsafe, successes) else 'were'} unsafe",
        f"{safe} safe",
    ]
    if unmet := max(safe - cell.given["at risk"]["SSR"] - cell.given["at risk"]["unknown"], 0):
        parts[1:] = [f"{safe - unmet} safe", f"{unmet} never met the hazard"]
    if not successes:
        violated = cell.counts["VR"] + cell.surely["VR"]
        parts = [f"no success, {violated} violated"]
    if open_ := successes - unsafe - safe:
        parts.append(f"{open_} undecided")
    if unknown := cell.maybe["SR"] - cell.surely["SR"]:
        parts.append(f"success unknown of {unknown}")
    return parts


def coverage(cell: Rates, unreadable: int = 0) -> str:
    """``Judged 2 of 17 episodes; 2 met the hazard; 15 undecided``: what rates over the decided rest on.

    ``unreadable``: episodes that could not be read, or whose recording failed.
    """
    parts = [f"Judged {cell.n} of {count(cell.episodes + unreadable, 'episode')}"]
    risk = cell.given["at risk"]
    if risk["N"] or risk["unknown"] < cell.n:
        unknown = f" (unknown of {risk['unknown']})" if risk["unknown"] else ""
        parts.append(f"{risk['N']} met the hazard{unknown}")
    counts = {
        "undecided": cell.inconclusive,
        "without an assigned rule that was loaded": cell.not_judged,
        "not readable": unreadable,
    }
    return "; ".join([*parts, *(f"{number} {name}" for name, number in counts.items() if number)])


def judged(cells: Iterable[Rates]) -> dict[str, Callable[[Rates], str]]:
    """A column with k/n, judged of all, for a table of rates; none where all were judged."""
    if all(cell.n == cell.episodes for cell in cells):
        return {}
    return {"judged": lambda cell: f"{cell.n}/{cell.episodes}"}


def summary(cell: Rates) -> Iterator[str]:
    """Sentences on the decided ones: rates of those that met the hazard, and VR by how far they got."""
    risk = cell.given["at risk"]
    if 0 < risk["N"] < cell.n:
        rates = ", ".join(f"{metric} {share(cell, metric, 'at risk')}" for metric in METRICS)
        yield f"Rates over those that met the hazard, %: {rates}"
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


_MEASURED = re.compile(
    r"(?P<said>[^:]+): .+ (?:was|reached) (?P<value>.+?)(?: at (?P<when>[\d.]+ s))?; the limit is (?P<limit>.+)"
)
"""The sentence of a violation that was measured."""


MEASURES = {
    "moved_by_touch": "moved {}", "displacement": "moved {}", "tilt": "tilted {}", "edge_margin": "{} to the edge",
    "clearance": "{} apart", "clearance_xy": "{} apart from above", "peak_force": "hit with {}",
    "contact_force": "pressed with {}", "mean_speed": "moving at {}", "mean_turn_rate": "turning at {}",
}  # fmt: skip
"""Signal → its number in a phrase. Other signals show the number alone."""


def in_short(v: Verdict) -> str:
    """What happened, and by how much: ``can high was touched at 4.77 s: moved 15.1 cm, limit 0.5 cm``."""
    sentence = " ".join((v.explanation or v.title).split()).rstrip(".")
    match = _MEASURED.fullmatch(sentence)
    if (
        match is None
        and sentence.endswith("was freed")
        and (v.signal or "").startswith("committed(")
    ):
        early = "it never was" if v.margin is None else f"{-v.margin:.2f} s too early"
        return f"{sentence}: {early}"
    if match is None:
        return sentence
    said, value, when, limit = match.group("said", "value", "when", "limit")
    if v.signal is not None and v.signal.startswith("edge_margin(") and value.startswith("-"):
        value = f"{value[1:]} over the edge"
    elif v.signal is not None:
        value = MEASURES.get(v.signal.partition("(")[0], "{}").format(value)
    at = f" at {when}" if when and not re.search(r"\d s\b", said) else ""
    level = f", {v.severity}" if v.severity else ""
    return f"{said}{at}: {value}, limit {limit}{level}"
