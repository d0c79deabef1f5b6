"""The head of the page: one sentence, and the four rates with their intervals."""

from __future__ import annotations

from html import escape

from safestage_eval.metrics.aggregate import Aggregate
from safestage_eval.metrics.interval import wilson
from safestage_eval.metrics.rates import METRICS, Rates
from safestage_eval.report.summary import coverage, percent_between, summary, unsafe_successes

WORDS = {
    "SR": ("Success rate", "reached the goal"),
    "SSR": ("Safe success rate", "reached it, and broke no rule"),
    "USR": ("Unsafe success rate", "reached it, and broke a rule"),
    "VR": ("Violation rate", "broke a rule, whether they reached the goal or not"),
}
"""Metric → its name, and what counts."""


def interval(k: int, n: int) -> str:
    """Wilson's 95 % interval of k of n."""
    bounds = wilson(k, n)
    return "–" if bounds is None else f"{100 * bounds[0]:.1f}–{100 * bounds[1]:.1f} %"


def headline(aggregate: Aggregate) -> str:
    """Write what became of the successes, then a tile for each rate."""
    whole = aggregate.whole
    tiles = "".join(_tile(whole, metric) for metric in METRICS)
    said = " · ".join(unsafe_successes(whole)) or coverage(whole)
    items = "".join(f"<li>{escape(line[:1].upper() + line[1:])}.</li>" for line in summary(whole))
    return (
        '<section id="headline" aria-labelledby="headline-title">'
        '<h2 id="headline-title" class="visually-hidden">Headline</h2>'
        f'<p class="lead">{escape(said)}</p><dl class="tiles">{tiles}</dl>'
        f'<p class="small soft">{escape(coverage(whole))}.</p>'
        + (f'<ul class="small soft">{items}</ul>' if items else "")
        + "</section>"
    )


def _tile(whole: Rates, metric: str) -> str:
    """A rate over all that were judged: an interval where some are undecided."""
    name, meaning = WORDS[metric]
    total, surely = whole.n + whole.inconclusive, whole.counts[metric] + whole.surely[metric]
    open_ = whole.maybe[metric] - whole.surely[metric]
    of_all = f"{surely:,} of {total:,} {meaning}" + (f", {open_:,} undecided" if open_ else "")
    below = "" if open_ else f"95 % interval {interval(surely, total)}"
    return (
        f'<div class="tile {metric.lower()}"><dt>{name} <abbr>{metric}</abbr></dt>'
        f'<dd><span class="big">{percent_between(*(whole.bounds(metric) or (None, None)))}</span>'
        f'<span class="soft">{of_all}</span><span class="soft">{below}</span></dd></div>'
    )
