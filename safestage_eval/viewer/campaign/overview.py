"""The results of a run: rates, tables and plots, one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import chain, groupby
from typing import Any
from urllib.parse import quote

from safestage_eval._text.plural import count
from safestage_eval.metrics import Outcome
from safestage_eval.metrics.aggregate import Aggregate
from safestage_eval.metrics.interval import wilson
from safestage_eval.metrics.rates import METRICS, STAGES, Rates
from safestage_eval.metrics.seeds import total
from safestage_eval.report import aggregate_report
from safestage_eval.report.summary import coverage, percent_between, summary, unsafe_successes
from safestage_eval.version import __version__

from . import charts
from .episode_pieces import Pieces


@dataclass(frozen=True)
class Report:
    """Contents of a report.

    Attributes:
        title: its heading.
        source: where the results come from, as readers should know it.
        counts: the outcomes, counted.
        rows: result rows; empty for a bare table of outcomes.
        outcomes: of a bare table.
        pieces: the evidence of episodes; None without traces.
        notes: further remarks for the reader.
        titles: rule → what it asks.
    """

    title: str
    source: str
    counts: Aggregate
    rows: Sequence[Mapping[str, Any]] = ()
    outcomes: Sequence[Outcome] = ()
    pieces: Pieces | None = None
    notes: Sequence[str] = field(default=())
    titles: Mapping[str, str] = field(default_factory=dict)


def overview(report: Report) -> list[str]:
    """Write the sections as HTML, a menu of them first."""
    counts = report.counts
    sweeps = report.pieces.sweeps if report.pieces is not None else ()
    parts = {
        "Headline": headline(counts),
        "Success and safety": charts.success_and_safety(counts),
        "Rules broken most": rules_broken(report.rows, report.titles),
        "Tasks": heatmap(counts),
        "Thresholds": charts.sensitivity(sweeps),
        "Details": _details(counts),
    }
    there = {name: html for name, html in parts.items() if html}
    return [f"<header>{_facts(report)}{_menu(there)}</header>", *there.values(), _footer(report)]


def _menu(parts: Mapping[str, str]) -> str:
    items = "".join(
        f'<li><a href="#{html.partition("id=")[2].split(chr(34))[1]}">{name}</a></li>'
        for name, html in parts.items()
    )
    return f'<nav class="no-print" aria-label="Results"><ul>{items}</ul></nav>'


def _details(counts: Aggregate) -> str:
    uneven = "".join(f"<li>{escape(problem.message)}</li>" for problem in counts.problems)
    return (
        '<details id="details"><summary><h2>Details</h2> result tables</summary>'
        f'<section id="tables" aria-label="Result tables">{aggregate_report.render(counts, "html")}'
        + (f'<ul class="small">{uneven}</ul>' if uneven else "")
        + "</section></details>"
    )


def _facts(report: Report) -> str:
    counts = report.counts
    several = {
        "task": len({o.task for o in counts.outcomes if o.task}),
        "policy": len(counts.policies),
        "prompt": len(counts.prompts),
    }
    said = [f"{len(counts.outcomes):,} rollouts"]
    said += [count(number, noun) for noun, number in several.items() if number]
    return f"<p>{escape(' · '.join([*said, f'from {report.source}']))}</p>"


def _footer(report: Report) -> str:
    notes = [
        "S: the rollout reached its goal. V: a rule that is assigned to its task was violated. "
        "SR, SSR, USR and VR are the shares of S, of S without V, of S with V, and of V, all over the "
        "same rollouts. Where some are undecided a rate is an interval: between what it is if they come out "
        "one way and the other. The tables under Details are over the decided ones.",
        "95 % intervals are Wilson's and take rollouts as independent; those of one task are alike, so "
        "the truth is wider.",
        *report.notes,
    ]
    if report.pieces is not None:
        notes += [f"Not shown: {problem.message}" for problem in report.pieces.problems[:20]]
        if report.pieces.differing:
            notes.append(
                f"{len(report.pieces.differing)} episodes were judged again under rules that differ from "
                "those of the results; each says where."
            )
    versions = sorted({str(row["version"]) for row in report.rows if row.get("version")})
    made = f"Made with SafeStage {__version__}"
    made += f"; results of version {', '.join(versions)}." if versions else "."
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<footer><h2>How to read this</h2><ul>{items}</ul><p class="small">{escape(made)}</p></footer>'


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


SHOWN_RULES = 12
"""Rules that are listed."""


def rules_broken(rows: Sequence[Mapping[str, Any]], titles: Mapping[str, str]) -> str:
    """A row per rule that its episodes violate, the one with most violations first; empty without any."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        if row.get("assigned") and row.get("verdict") is not None:
            found.setdefault(str(row["rule"]), Counter())[str(row["verdict"])] += 1
    order = sorted(found, key=lambda rule: (-found[rule]["violation"], rule))
    broken = [rule for rule in order if found[rule]["violation"]]
    if not broken:
        return ""
    most = found[broken[0]]["violation"]
    body = "".join(
        _rule_row(rule, found[rule], titles.get(rule, ""), most) for rule in broken[:SHOWN_RULES]
    )
    more = len(broken) - SHOWN_RULES
    return charts.section(
        "rules", "Rules broken most",
        '<div class="scroll" tabindex="0" role="region" aria-label="Rules broken most"><table class="results rules">'
        '<thead><tr><th scope="col">Rule</th><th scope="col">Asks</th><th scope="col" class="amount">Violated</th>'
        '<th scope="col"><span class="visually-hidden">Share</span></th>'
        f'<th scope="col" class="amount">Undecided</th></tr></thead><tbody>{body}</tbody></table></div>',
        f'<p class="small soft">{more} more rules were violated.</p>' if more > 0 else "",
    )  # fmt: skip


def _rule_row(rule: str, counts: Counter[str], title: str, most: int) -> str:
    violated, asked = counts["violation"], counts.total() - counts["not_applicable"]
    link = f"#rule={quote(rule)}&amp;verdict=violation"
    bar = (
        '<svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect class="q unsafe_success" width="{100 * violated / most:.1f}" height="10"/></svg>'
    )
    return (
        f'<tr><th scope="row"><a href="{link}">{escape(rule)}</a></th><td>{escape(title)}</td>'
        f'<td class="amount"><a href="{link}">{violated:,} of {asked:,}</a></td><td>{bar}</td>'
        f'<td class="amount">{counts["inconclusive"] or "–"}</td></tr>'
    )


SHOWN_METRICS = ("VR", "USR", "SSR", "SR")
"""Metrics that can be chosen; the first is shown at the beginning."""


def heatmap(aggregate: Aggregate) -> str:
    """A table with a row per task, the stages one after another, the worst tasks first."""
    pairs = aggregate.pairs
    found: dict[tuple[str, str], dict[tuple[str, str], list[Rates]]] = {}
    for (policy, prompt, stage, _, task, _), cell in aggregate.base.items():
        own = found.setdefault((stage, task or "–"), {})
        own.setdefault((policy, prompt), []).append(cell)
    whole = {row: total(chain(*own.values())) for row, own in found.items()}

    def order(row: tuple[str, str]) -> tuple[int, float, str]:
        stage = STAGES.index(row[0]) if row[0] in STAGES else len(STAGES)
        return stage, -(whole[row].bounds("VR") or (0.0,))[0], row[1]

    body = []
    for stage, rows in groupby(sorted(found, key=order), key=lambda row: row[0]):
        body.append(
            f'<tr class="group"><th scope="rowgroup" colspan="{len(pairs) + 2}">{escape(stage)}</th></tr>'
        )
        for row in rows:
            cells = [_cell(whole[row], task=row[1])]
            for policy, prompt in pairs:
                parts = found[row].get((policy, prompt))
                cells.append(
                    _cell(
                        None if parts is None else total(parts),
                        task=row[1],
                        policy=policy,
                        prompt=prompt,
                    )
                )
            body.append(f'<tr><th scope="row">{escape(row[1])}</th>{"".join(cells)}</tr>')
    top = "".join(
        f'<th scope="colgroup" colspan="{number}">{escape(policy)}</th>'
        for policy, number in Counter(policy for policy, _ in pairs).items()
    )
    second = "".join(f'<th scope="col">{escape(prompt)}</th>' for _, prompt in pairs)
    choices = "".join(
        f'<button type="button" data-metric="{m}" aria-pressed="{str(m == SHOWN_METRICS[0]).lower()}">{m}</button>'
        for m in SHOWN_METRICS
    )
    return charts.section(
        "heatmap", "Tasks",
        '<p class="soft"><span id="heatmap-what">Violation rate</span> of each task in percent; '
        "within a stage, the tasks with most violations first. A cell leads to its episodes.</p>"
        f'<div class="choices no-print" role="group" aria-label="Rate">{choices}</div>'
        '<div class="scroll tall" tabindex="0" role="region" aria-label="Rates by task"><table class="heat">'
        f'<thead><tr><th scope="col" rowspan="2">Task</th><th scope="col" rowspan="2">All</th>{top}</tr>'
        f"<tr>{second}</tr></thead><tbody>{''.join(body)}</tbody></table></div>",
    )  # fmt: skip


def _cell(cell: Rates | None, **where: str) -> str:
    """A share of all that were judged, an interval where some are undecided; it leads to its episodes."""
    bounds = None if cell is None else cell.bounds(SHOWN_METRICS[0])
    if cell is None or bounds is None:
        return '<td class="none">–</td>'
    least = " ".join(str(cell.counts[metric] + cell.surely[metric]) for metric in SHOWN_METRICS)
    most = " ".join(str(cell.counts[metric] + cell.maybe[metric]) for metric in SHOWN_METRICS)
    low, high = (f"{100 * bound:.0f}" for bound in bounds)
    link = "&amp;".join(f"{name}={quote(value, safe='')}" for name, value in where.items())
    return (
        f'<td class="h{level(bounds[0])}" data-k="{least}" data-most="{most}" data-n="{cell.n + cell.inconclusive}">'
        f'<a href="#{link}">{low if low == high else f"{low}–{high}"}</a></td>'
    )


def level(share: float) -> int:
    """The shade, 0…10, of a share 0…1; only a share of 0 has shade 0."""
    return 0 if share <= 0 else max(1, min(10, round(10 * share)))
