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

from .render_csv import render_csv
from .render_json import render_json
from .render_markdown import render_markdown
from .render_text import render_text
from .summary import share
from .table import Table

LONGEST_NAME = 8
"""Characters of a side's name that leave a line of 80 room for the other columns."""


def render(comparison: Comparison, form: str) -> str:
    """The comparison in one of ``report.TABLE_FORMATS``. Raises KeyError for another."""
    if form == "json":
        return render_json(document(comparison))
    if form == "csv":
        return _csv(comparison)
    tables = [_table(comparison), *_engagement(comparison)]
    write = {"table": render_text, "markdown": render_markdown}[form]
    return write(tables, notes(comparison), _coverage(comparison))


def _coverage(comparison: Comparison) -> str:
    """``Compared 100 of 120 pairs; undecided 20``."""
    pairs = comparison.pairs
    n, undecided = len(pairs.both), len(pairs.undecided)
    counts = {"undecided": undecided, "no rule assigned or loaded": pairs.not_judged}
    sentence = in_one_sentence(comparison)
    parts = [f"{sentence}. Compared {n} of {count(n + sum(counts.values()), 'pair')}"]
    return "; ".join([*parts, *(f"{name} {number}" for name, number in counts.items() if number)])


def in_one_sentence(comparison: Comparison) -> str:
    """``diffusion: 34 points less success, 21 fewer unsafe successes``, of the second beside the first."""
    points = {c.of.metric: c.of.difference for c in comparison.lines if c.of.level == "all"}
    parts = [
        _points(points.get("SR"), "{} points more success", "{} points less success", "the same success"),
        _points(
            points.get("USR"), "{} more unsafe successes", "{} fewer unsafe successes",
            "as many unsafe successes",
        ),
    ]  # fmt: skip
    return f"{comparison.names[1]}: {', '.join(parts)}"


def _points(difference: float | None, more: str, less: str, same: str) -> str:
    if difference is None:
        return "nothing decided"
    number = decimal(100 * abs(difference), 1).removesuffix(".0")
    return same if number == "0" else (more if difference > 0 else less).format(number)


def document(comparison: Comparison) -> dict[str, Any]:
    """Everything as one object; rates in percent, differences in percentage points."""
    return {
        "version": __version__,
        "unit": "percent",
        "a": comparison.names[0],
        "b": comparison.names[1],
        "by": comparison.pairs.by,
        "paired_on": list(KEYS[comparison.pairs.by]),
        "pairs": len(comparison.pairs.both),
        "undecided": len(comparison.pairs.undecided),
        "not_judged": comparison.pairs.not_judged,
        "only_in_a": len(comparison.pairs.alone[0]),
        "only_in_b": len(comparison.pairs.alone[1]),
        "sides": {name: headline(cell) for name, cell in _sides(comparison).items()},
        "lines": [_row(line) for line in comparison.lines],
        "warnings": warnings(comparison),
    }


def warnings(comparison: Comparison) -> list[str]:
    """Claims over all pairs that the sample is too small for, and the size that would do."""
    return [
        f"{line.of.metric}: {_why_not(line)}"
        for line in comparison.lines
        if line.of.level == "all" and not line.significant
    ]


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
        bounds = [
            f"{c.of.metric} {_signed(c.of.least)} … {_signed(c.of.most)}"
            for c in comparison.lines
            if c.of.level == "all"
        ]
        text = (
            f"{count(len(pairs.undecided), 'pair')} could not be decided, not in N: whatever they"
        )
        lines.append(f"{text} are, the differences over all lie within {', '.join(bounds)}.")
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
    lines += [f"–: {reason} ({', '.join(where[:4])})." for reason, where in reasons.items()]
    return lines


def _heads(first: str, second: str) -> tuple[str, str]:
    """Headings of the two rates: names if both are short, for the title has them."""
    if max(len(first), len(second)) > LONGEST_NAME:
        first, second = "first", "second"
    return f"{first} %", f"{second} %"


def _table(comparison: Comparison) -> Table:
    a, b = comparison.names
    return Table(
        f"{a} → {b}",
        ("of", "metric", "pairs", *_heads(a, b), "difference", "95 % interval",
         "only first", "only second", "p", "Holm", "needs"),
        [
            [
                line.of.scope,
                line.of.metric,
                str(line.of.n),
                *map(decimal, line.of.percents),
                _signed(line.of.difference),
                _interval(line),
                str(line.of.sums[3]),
                str(line.of.sums[4]),
                _p(line.p),
                _p(line.p_holm) + " *" * line.significant,
                "–" if line.need is None or line.need.pairs is None else str(line.need.pairs),
            ]
            for line in comparison.lines
        ],
        2,
        grouped=True,
    )  # fmt: skip


def _sides(comparison: Comparison) -> dict[str, Rates]:
    """Each side's counts over the pairs."""
    return {
        name: rates(pair[i] for pair in comparison.pairs.both)
        for i, name in enumerate(comparison.names)
    }


def _engagement(comparison: Comparison) -> list[Table]:
    """Stages reached and episodes that met the hazard per side; no table where neither is known."""
    sides = _sides(comparison)
    any_known = any(
        cell.given["at risk"]["N"] or any(n for stage, n in cell.engagement.items() if stage)
        for cell in sides.values()
    )
    if not any_known:
        return []
    return [
        Table(
            "How far the paired rollouts got with the target, and VR by it: %, k/n",
            (
                "of",
                *ENGAGEMENT,
                "unknown",
                "VR given the hazard",
                *(f"VR given {name}" for name in CONDITIONS[1:]),
            ),
            [
                [
                    name,
                    *map(str, cell.engagement.values()),
                    *(share(cell, "VR", condition) for condition in CONDITIONS),
                ]
                for name, cell in sides.items()
            ],
            1,
        )
    ]


def _why_not(line: Line) -> str:
    if not line.of.n or line.need is None:
        return f"{line.reason}; nothing can be claimed"
    need, pairs = line.need, line.of.n
    least = f"{100 * need.smallest:.1f} points is the least that this sample would show"
    if need.pairs is None:
        return f"no difference in {count(pairs, 'pair')}; {least}"
    text = (
        f"{count(pairs, 'pair')} cannot carry a difference of {_signed(line.of.difference)} points "
        f"(Holm p {_p(line.p_holm)}, interval {_interval(line)}); {least}"
    )
    here = pairs / len(line.of.tasks)
    if need.per_task is None:
        would = f"more rollouts of these {len(line.of.tasks)} tasks would not"
        return f"{text}; {would}, about {need.tasks} tasks of {here:.0f} pairs each would"
    return f"{text}; about {need.per_task} pairs per task would, where there are {here:.0f}"


def _row(line: Line) -> dict[str, Any]:
    n, k_a, k_b, only_a, only_b = line.of.sums
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
        "rate_a": line.of.percents[0],
        "rate_b": line.of.percents[1],
        "difference": _percent(line.of.difference),
        "low": _percent(line.interval[0]) if line.interval else None,
        "high": _percent(line.interval[1]) if line.interval else None,
        "p": line.p,
        "p_holm": line.p_holm,
        "significant": line.significant,
        "least": _percent(line.of.least),
        "most": _percent(line.of.most),
        "needed_pairs": need and need.pairs,
        "needed_pairs_per_task": need and need.per_task,
        "needed_tasks": need and need.tasks,
        "smallest_difference": _percent(need.smallest) if need else None,
        "alike": need and need.alike,
        "reason": line.reason,
    }


def _csv(comparison: Comparison) -> str:
    rows = [
        {"a": comparison.names[0], "b": comparison.names[1], **_row(line)}
        for line in comparison.lines
    ]
    return render_csv(list(rows[0]), rows)


def _percent(value: float | None) -> float | None:
    return None if value is None else 100 * value


def _signed(value: float | None) -> str:
    text = decimal(_percent(value))
    return text if text.startswith(("-", "–")) or not text.strip("0.") else f"+{text}"


def _interval(line: Line) -> str:
    return f"{_signed(line.interval[0])} … {_signed(line.interval[1])}" if line.interval else "–"


def _p(value: float | None) -> str:
    if value is None:
        return "–"
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"
