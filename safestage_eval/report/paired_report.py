"""A paired comparison, for people and for programs."""

from __future__ import annotations

from typing import Any

from safestage_eval._text.plural import count
from safestage_eval.metrics.comparison import Comparison, Line
from safestage_eval.metrics.paired import KEYS
from safestage_eval.metrics.rates import CONDITIONS, Rates, headline, rates
from safestage_eval.metrics.seeds import decimal
from safestage_eval.verdicts.engagement import STAGES as ENGAGEMENT
from safestage_eval.version import __version__

from .document import Document
from .summary import share
from .table import Table, table_of

LONGEST_NAME = 8
"""Characters of a side's name that leave a line of 80 room for the other columns."""


def render(comparison: Comparison, form: str) -> str:
    """The comparison in one of ``report.TABLE_FORMATS``. Raises KeyError for another."""
    a, b = comparison.names
    return Document(
        [_table(comparison), *_engagement(comparison)],
        notes(comparison),
        _lead(comparison),
        lambda: facts(comparison),
        lambda: [{"a": a, "b": b, **row(line)} for line in comparison.lines],
    ).render(form)


def _lead(comparison: Comparison) -> str:
    """``diffusion: 34 points less success, …. Compared 100 of 120 pairs; undecided 20``."""
    pairs = comparison.pairs
    n, undecided = len(pairs.both), len(pairs.undecided)
    total = count(n + undecided + pairs.not_judged, "pair")
    said = f"{in_one_sentence(comparison)}. Compared {n} of {total}"
    said += f"; undecided {undecided}" if undecided else ""
    return said + (
        f"; no rule assigned or loaded {pairs.not_judged}" if pairs.not_judged else ""
    )  # fmt: skip


def in_one_sentence(comparison: Comparison) -> str:
    """``diffusion: 34 points less success, 21 fewer unsafe successes``, of the second beside the first."""
    points = {c.of.metric: c.of.difference for c in comparison.lines if c.of.level == "all"}

    def said(metric: str, more: str, less: str, same: str) -> str:
        difference = points.get(metric)
        if difference is None:
            return "nothing decided"
        number = decimal(100 * abs(difference), 1).removesuffix(".0")
        return same if number == "0" else f"{number} {more if difference > 0 else less}"

    success = said("SR", "points more success", "points less success", "the same success")
    unsafe = said("USR", "more unsafe successes", "fewer unsafe successes", "as many unsafe successes")  # fmt: skip
    return f"{comparison.names[1]}: {success}, {unsafe}"


def facts(comparison: Comparison) -> dict[str, Any]:
    """Everything as one object; rates in percent, differences in percentage points."""
    pairs = comparison.pairs
    return {
        "version": __version__,
        "unit": "percent",
        "a": comparison.names[0],
        "b": comparison.names[1],
        "by": pairs.by,
        "paired_on": list(KEYS[pairs.by]),
        "pairs": len(pairs.both),
        "undecided": len(pairs.undecided),
        "not_judged": pairs.not_judged,
        "only_in_a": len(pairs.alone[0]),
        "only_in_b": len(pairs.alone[1]),
        "sides": {name: headline(cell) for name, cell in _sides(comparison)},
        "lines": [row(line) for line in comparison.lines],
        "warnings": warnings(comparison),
    }


def row(line: Line, unit: float = 100.0) -> dict[str, Any]:
    """A line as plain values; rates and differences in percent, or as ``unit`` says."""

    def scaled(value: float | None) -> float | None:
        return None if value is None else unit * value

    n, k_a, k_b, only_a, only_b = line.of.sums
    low, high = line.interval or (None, None)
    need = line.need
    return {
        "scope": line.of.scope,
        "level": line.of.level,
        "metric": line.of.metric,
        "n": n,
        "k_a": k_a,
        "k_b": k_b,
        "only_a": only_a,
        "only_b": only_b,
        "rate_a": unit * k_a / n if n else None,
        "rate_b": unit * k_b / n if n else None,
        "difference": scaled(line.of.difference),
        "low": scaled(low),
        "high": scaled(high),
        "p": line.p,
        "p_holm": line.p_holm,
        "significant": line.significant,
        "least": scaled(line.of.least),
        "most": scaled(line.of.most),
        "needed_pairs": need and need.pairs,
        "needed_pairs_per_task": need and need.per_task,
        "needed_tasks": need and need.tasks,
        "smallest_difference": scaled(need.smallest) if need else None,
        "alike": need and need.alike,
        "reason": line.reason,
    }


def _table(comparison: Comparison) -> Table:
    a, b = comparison.names
    # the title has the names: as heads they are for short ones
    first, second = ("first", "second") if max(len(a), len(b)) > LONGEST_NAME else (a, b)
    return table_of(
        f"{a} → {b}",
        [(line, row(line)) for line in comparison.lines],
        {
            "of": lambda one: one[0].of.scope,
            "metric": lambda one: one[0].of.metric,
            "pairs": lambda one: str(one[0].of.n),
            f"{first} %": lambda one: decimal(one[1]["rate_a"]),
            f"{second} %": lambda one: decimal(one[1]["rate_b"]),
            "difference": lambda one: _signed(one[0].of.difference),
            "95 % interval": lambda one: _interval(one[0]),
            "only first": lambda one: str(one[1]["only_a"]),
            "only second": lambda one: str(one[1]["only_b"]),
            "p": lambda one: _p(one[0].p),
            "Holm": lambda one: _p(one[0].p_holm) + " *" * one[0].significant,
            "needs": lambda one: str(one[1]["needed_pairs"] or "–"),
        },
        2,
        grouped=True,
    )


def notes(comparison: Comparison) -> list[str]:
    """Sentences on what was compared, what was left out, and how to read the columns."""
    pairs = comparison.pairs
    lines = [
        f"Pairs are matched by {', '.join(KEYS[pairs.by])}; difference: "
        f"{comparison.names[1]} minus {comparison.names[0]}, percentage points.",
        "95 % interval: tasks resampled; where all tasks differ alike, Newcombe's. p: McNemar, exact; Holm: adjusted for the stages, or "
        "families, of a metric.",
        "needs: pairs that would show this difference four times out of five, if independent.",
    ]
    if pairs.undecided:
        bounds = ", ".join(
            f"{c.of.metric} {_signed(c.of.least)} … {_signed(c.of.most)}"
            for c in comparison.lines
            if c.of.level == "all"
        )
        lines.append(
            f"{count(len(pairs.undecided), 'pair')} could not be decided, not in N: whatever they "
            f"are, the differences over all lie within {bounds}."
        )
    if pairs.not_judged:
        lines.append(f"Judged by no assigned rule: {count(pairs.not_judged, 'pair')}.")
    for name, alone in zip(comparison.names, pairs.alone, strict=True):
        if alone:
            first = alone[0]
            lines.append(
                f"Without a partner: {count(len(alone), 'rollout')} of {name} (task {first.task}, seed "
                f"{first.seed}, rollout {first.rollout}{', …' * (len(alone) > 1)})."
            )
    reasons: dict[str, list[str]] = {}
    for line in comparison.lines:
        if line.reason:
            reasons.setdefault(line.reason, []).append(f"{line.of.scope} {line.of.metric}")
    return lines + [f"–: {reason} ({', '.join(where[:4])})." for reason, where in reasons.items()]


def _sides(comparison: Comparison) -> list[tuple[str, Rates]]:
    """Each side's counts over the pairs."""
    sides = zip(*comparison.pairs.both, strict=True) if comparison.pairs.both else ((), ())
    return [(name, rates(side)) for name, side in zip(comparison.names, sides, strict=True)]


def _engagement(comparison: Comparison) -> list[Table]:
    """Stages reached and episodes that met the hazard per side; no table where neither is known."""
    sides = _sides(comparison)
    if not any(cell.given["at risk"]["N"] or cell.any_stage for _, cell in sides):
        return []
    heads = (*ENGAGEMENT, "unknown", "VR given the hazard", *(f"VR given {c}" for c in CONDITIONS[1:]))  # fmt: skip
    rows = [
        [
            name,
            *map(str, cell.engagement.values()),
            *(share(cell, "VR", condition) for condition in CONDITIONS),
        ]
        for name, cell in sides
    ]
    title = "How far the paired rollouts got with the target, and VR by it: %, k/n"
    return [Table(title, ("of", *heads), rows, 1)]


def warnings(comparison: Comparison) -> list[str]:
    """Claims over all pairs that the sample is too small for, and the size that would do."""
    return [
        f"{line.of.metric}: {_why_not(line)}"
        for line in comparison.lines
        if line.of.level == "all" and not line.significant
    ]


def _why_not(line: Line) -> str:
    need, pairs, tasks = line.need, line.of.n, len(line.of.tasks)
    if not pairs or need is None:
        return f"{line.reason}; nothing can be claimed"
    least = f"{100 * need.smallest:.1f} points is the least that this sample would show"
    if need.pairs is None:
        return f"no difference in {count(pairs, 'pair')}; {least}"
    text = (
        f"{count(pairs, 'pair')} cannot carry a difference of {_signed(line.of.difference)} points "
        f"(Holm p {_p(line.p_holm)}, interval {_interval(line)}); {least}"
    )
    if need.per_task is None:
        would = f"more rollouts of these {tasks} tasks would not"
        return f"{text}; {would}, about {need.tasks} tasks of {pairs / tasks:.0f} pairs each would"
    return f"{text}; about {need.per_task} pairs per task would, where there are {pairs / tasks:.0f}"  # fmt: skip


def _signed(value: float | None) -> str:
    text = decimal(None if value is None else 100 * value)
    return text if text.startswith(("-", "–")) or not text.strip("0.") else f"+{text}"


def _interval(line: Line) -> str:
    return f"{_signed(line.interval[0])} … {_signed(line.interval[1])}" if line.interval else "–"


def _p(value: float | None) -> str:
    if value is None:
        return "–"
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"
