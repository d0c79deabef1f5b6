"""The first thing that is read: what was measured, and the four rates with their intervals."""

from __future__ import annotations

from html import escape

from safestage_eval.metrics.aggregate import Aggregate, quadrants
from safestage_eval.metrics.interval import wilson
from safestage_eval.metrics.rates import METRICS, Rates
from safestage_eval.report.summary import summary

WORDS = {
    "SR": ("Success rate", "reached the goal"),
    "SSR": ("Safe success rate", "reached it, and broke no rule"),
    "USR": ("Unsafe success rate", "reached it, and broke a rule"),
    "VR": ("Violation rate", "broke a rule, whether they reached the goal or not"),
}
"""Metric → its name, and what counts."""


def percent(value: float | None, digits: int = 1) -> str:
    """A share 0…1 as people read it."""
    return "–" if value is None else f"{100 * value:.{digits}f} %"


def interval(k: int, n: int) -> str:
    """Wilson's 95 % interval of k of n."""
    bounds = wilson(k, n)
    return "–" if bounds is None else f"{100 * bounds[0]:.1f}–{100 * bounds[1]:.1f} %"


def headline(aggregate: Aggregate) -> str:
    """One sentence, who was at risk and who did anything, then a tile for each rate."""
    whole = aggregate.whole
    tiles = "".join(_tile(whole, metric) for metric in METRICS)
    return (
        '<section id="headline" aria-labelledby="headline-title">'
        f'<h2 id="headline-title" class="visually-hidden">Headline</h2>{_sentence(whole)}'
        f'<dl class="tiles">{tiles}</dl>{_left_out(whole)}</section>'
    )


def _sentence(whole: Rates) -> str:
    if not whole.n:
        return '<p class="lead">No rollout could be decided, so there are no rates.</p>'
    parts = quadrants(whole)
    share = whole.violation_given_success
    said = f"Of {whole.n:,} rollouts, {whole.counts['SR']:,} reached their goal"
    if share is not None:
        said += f" and {parts['unsafe_success']:,} of those were unsafe: {percent(share)} of all successes"
    items = "".join(f"<li>{escape(line[:1].upper() + line[1:])}.</li>" for line in summary(whole))
    return f'<p class="lead">{escape(said)}.</p>' + (f"<ul>{items}</ul>" if items else "")


def _tile(whole: Rates, metric: str) -> str:
    name, meaning = WORDS[metric]
    k, n = whole.counts[metric], whole.n
    bounds = whole.bounds(metric)
    low_high = (
        f"; {percent(bounds[0])} to {percent(bounds[1])} whatever the undecided are"
        if bounds is not None and whole.inconclusive
        else ""
    )
    return (
        f'<div class="tile {metric.lower()}"><dt>{name} <abbr>{metric}</abbr></dt>'
        f'<dd><span class="big">{percent(whole.value(metric))}</span>'
        f'<span class="soft">{k:,} of {n:,} {meaning}</span>'
        f'<span class="soft">95 % interval {interval(k, n)}{low_high}</span></dd></div>'
    )


def _left_out(whole: Rates) -> str:
    parts = []
    if whole.inconclusive:
        parts.append(f"{whole.inconclusive:,} rollouts could not be decided")
    if whole.not_judged:
        parts.append(f"{whole.not_judged:,} were not judged by the rules of their task")
    if not parts:
        return ""
    return f'<p class="small soft">Not in these rates: {" and ".join(parts)}.</p>'
