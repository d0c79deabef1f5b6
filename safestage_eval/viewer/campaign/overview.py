"""The results of a run: rates, tables and plots, one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from safestage_eval.metrics import Outcome
from safestage_eval.metrics.aggregate import Aggregate
from safestage_eval.report import aggregate_report
from safestage_eval.version import __version__

from . import charts, headline, heatmap, rules_broken
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
        "Headline": headline.headline(counts),
        "Success and safety": charts.success_and_safety(counts),
        "Rules broken most": rules_broken.rules_broken(report.rows, report.titles),
        "Tasks": heatmap.heatmap(counts),
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
    tasks = len({o.task for o in counts.outcomes if o.task})
    facts = [
        f"{len(counts.outcomes):,} rollouts",
        _counted(tasks, "task"),
        _counted(len(counts.policies), "policy", "policies"),
        _counted(len(counts.prompts), "prompt"),
        f"from {report.source}",
    ]
    return f"<p>{escape(' · '.join(fact for fact in facts if fact))}</p>"


def _counted(number: int, one: str, several: str = "") -> str:
    if not number:
        return ""
    return f"{number} {one if number == 1 else several or one + 's'}"


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
