"""The head of the page: one sentence, and the four rates with their intervals."""

from __future__ import annotations

from html import escape

from safestage_eval.metrics.aggregate import Aggregate, quadrants
from safestage_eval.metrics.interval import wilson
from safestage_eval.metrics.rates import METRICS, Rates
from safestage_eval.report.summary import coverage, summary

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
    """Write how many were judged and at risk, their outcomes, then a tile for each rate."""
    whole = aggregate.whole
    tiles = "".join(_tile(whole, metric) for metric in METRICS)
    return (
        '<section id="headline" aria-labelledby="headline-title">'
        '<h2 id="headline-title" class="visually-hidden">Headline</h2>'
        f'<p class="lead">{escape(coverage(whole))}.</p>{_outcomes(whole)}'
        f'<dl class="tiles">{tiles}</dl>{_left_out(whole)}</section>'
    )


def _outcomes(whole: Rates) -> str:
    if not whole.n:
        return "<p>No rollout could be decided, so there are no rates.</p>"
    unsafe = quadrants(whole)["unsafe_success"]
    share = whole.violation_given_success
    text = f"Of {whole.n:,} judged rollouts, {whole.counts['SR']:,} reached their goal"
    if share is not None:
        text += f" and {unsafe:,} of those were unsafe: {percent(share)} of all successes"
    items = "".join(f"<li>{escape(line[:1].upper() + line[1:])}.</li>" for line in summary(whole))
    return f"<p>{escape(text)}.</p>" + (f"<ul>{items}</ul>" if items else "")


def _tile(whole: Rates, metric: str) -> str:
    """A rate; where rollouts were left undecided its counts, and between which rates it lies."""
    name, meaning = WORDS[metric]
    k, n = whole.counts[metric], whole.n
    big, of_all = percent(whole.value(metric)), f"{k:,} of {n:,} {meaning}"
    bounds = whole.bounds(metric)
    if bounds is not None and whole.inconclusive:
        big, low, high = f"{k:,}/{n:,}", percent(bounds[0]), percent(bounds[1])
        of_all = f"{meaning}; {whole.inconclusive:,} undecided, so between {low} and {high}"
    return (
        f'<div class="tile {metric.lower()}"><dt>{name} <abbr>{metric}</abbr></dt>'
        f'<dd><span class="big">{big}</span><span class="soft">{of_all}</span>'
        f'<span class="soft">95 % interval of those judged <span class="whole">{interval(k, n)}</span></span></dd></div>'
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
