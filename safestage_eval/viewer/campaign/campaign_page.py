"""The page of a campaign, built from its parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from safestage_eval.metrics import Outcome
from safestage_eval.metrics.aggregate import Aggregate
from safestage_eval.version import __version__
from safestage_eval.viewer.html_page import THEME_SWITCH, page, part

from . import charts, findings, headline, heatmap, rate_tables
from .episode_sections import Sections
from .packed import block, packed

KINDS = {
    "violation": "violations",
    "unsafe": "unsafe successes",
    "inconclusive": "inconclusive",
    "pass": "passes",
    "other": "other rules' violations",
    "drawn": "with a timeline",
    "": "everything",
}
"""Value of the filter → as it is named; ``report.js`` has the same values."""

HEADS = (
    ("verdict", "verdict", "Verdict"), ("episode", "task", "Episode"), ("rule", "rule", "Rule"),
    ("what", "", "What happened"), ("time", "time", "Time"), ("value", "value", "Value"),
    ("margin", "normalised", "Margin"),
)  # fmt: skip
"""Column class, the data that it is sorted by, and its head."""


@dataclass(frozen=True)
class Report:
    """The page's contents.

    Attributes:
        title: its heading.
        source: where the results come from, as readers should know it.
        counts: the outcomes, counted.
        rows: result rows; empty for a bare table of outcomes.
        outcomes: of a bare table.
        sections: what was drawn from traces; None without traces.
        notes: further remarks for the reader.
    """

    title: str
    source: str
    counts: Aggregate
    rows: Sequence[Mapping[str, Any]] = ()
    outcomes: Sequence[Outcome] = ()
    sections: Sections | None = None
    notes: Sequence[str] = field(default=())


def build(report: Report) -> str:
    """Build the page as HTML. The same input gives the same bytes."""
    html = dict(report.sections.html) if report.sections is not None else {}
    numbers = {name: i for i, name in enumerate(html)}
    data = (
        findings.of_results(report.rows, numbers)
        if report.rows
        else findings.of_outcomes(report.outcomes)
    )
    sweeps = report.sections.sweeps if report.sections is not None else ()
    parts = {
        "Headline": headline.headline(report.counts),
        "Tables": rate_tables.tables(report.counts),
        "Success and safety": charts.success_and_safety(report.counts),
        "Stages": charts.profiles(report.counts),
        "Thresholds": charts.sensitivity(sweeps),
        "Tasks": heatmap.heatmap(report.counts),
        "Findings": _findings(bare=not report.rows, sections=len(html)),
    }
    body = [
        '<a class="skip" href="#main">Skip to the content</a>',
        _top({name: html for name, html in parts.items() if html}),
        f'<main id="main" class="page">{_header(report)}',
        *parts.values(),
        _footer(report),
        "</main>",
        block("findings-data", packed(data)),
        *(block(f"episode-{i}", text) for i, text in enumerate(html.values())),
    ]
    return page(
        report.title,
        body,
        styles=[part("report.css")],
        scripts=[part("report.js", __package__)],
        data={"plain": _plain(report)},
    )


def _top(parts: Mapping[str, str]) -> str:
    items = "".join(
        f'<li><a href="#{html.partition("id=")[2].split(chr(34))[1]}">{name}</a></li>'
        for name, html in parts.items()
    )
    logo = (
        '<svg viewBox="0 0 32 32" aria-hidden="true"><path d="M16 2 29 8v8c0 8-6 12-13 14C9 28 3 24 3 16V8z"/>'
        '<path d="m10 16 5 5 8-10"/></svg>'
    )
    return (
        f'<div class="top"><div class="page"><span class="brand">{logo}SafeStage</span>'
        f'<nav aria-label="Sections"><ul>{items}</ul></nav>{THEME_SWITCH}</div></div>'
    )


def _header(report: Report) -> str:
    counts = report.counts
    tasks = len({o.task for o in counts.outcomes if o.task})
    facts = [
        f"{len(counts.outcomes):,} rollouts",
        _counted(tasks, "task"),
        _counted(len(counts.policies), "policy", "policies"),
        _counted(len(counts.prompts), "prompt"),
        f"from {report.source}",
    ]
    return (
        f"<header><h1>{escape(report.title)}</h1>"
        f"<p>{escape(' · '.join(fact for fact in facts if fact))}</p></header>"
    )


def _counted(number: int, one: str, several: str = "") -> str:
    if not number:
        return ""
    return f"{number} {one if number == 1 else several or one + 's'}"


def _findings(*, bare: bool, sections: int) -> str:
    kinds = "".join(
        f'<option value="{value}">{name}</option>'
        for value, name in KINDS.items()
        if not (bare and value in ("other",)) and (sections or value != "drawn")
    )
    selects = "".join(
        f'<label>{name.capitalize()}<select id="find-{name}"><option value="">all</option></select></label>'
        for name in ("stage", "policy", "prompt", *(() if bare else ("rule",)))
    )
    heads = "".join(
        f'<th scope="col" class="c-{css}{" amount" if css in ("time", "value", "margin") else ""}"'
        + (
            f' data-sort="{sort}"><button type="button">{name}</button></th>'
            if sort
            else f">{name}</th>"
        )
        for css, sort, name in HEADS
    )
    rows = "One row per rollout" if bare else "One row per episode and rule"
    more = (
        f" {sections:,} episodes have a timeline and a key frame: open a row to see them."
        if sections
        else ""
    )
    return (
        '<section id="findings" aria-labelledby="findings-title" aria-busy="true">'
        f'<h2 id="findings-title">Findings</h2><p class="soft">{rows}; the gravest first.{more}</p>'
        '<form id="filters" class="filters" role="search" aria-label="Findings">'
        '<label>Search<input id="find-text" type="search" autocomplete="off" '
        'placeholder="task, policy, signal, words"></label>'
        f'<label>Show<select id="find-kind">{kinds}</select></label>{selects}</form>'
        f'<table class="findings{" bare" if bare else ""}"><caption class="visually-hidden">Findings'
        f'</caption><thead><tr>{heads}</tr></thead><tbody id="findings-body"></tbody></table>'
        '<div class="pager"><button type="button" id="findings-back">Back</button>'
        '<button type="button" id="findings-next">Next</button>'
        '<span id="findings-count" class="number soft" role="status">loading …</span></div>'
        "<noscript><p>The list needs JavaScript; everything above does not.</p></noscript></section>"
    )


def _plain(report: Report) -> str:
    """The text under an episode without a section."""
    if report.sections is None:
        return "No timeline: the report was made without the traces."
    return "No timeline: this episode is not among those that were drawn."


def _footer(report: Report) -> str:
    notes = [
        "S: the rollout reached its goal. V: a rule that is assigned to its task was violated. "
        "SR, SSR, USR and VR are the shares of S, of S without V, of S with V, and of V, all over the "
        "same decided rollouts.",
        "95 % intervals are Wilson's and take rollouts as independent; those of one task are alike, so "
        "the truth is wider.",
        *report.notes,
    ]
    if report.sections is not None:
        notes += [f"Not drawn: {problem.message}" for problem in report.sections.problems[:20]]
        if report.sections.differences:
            notes.append(
                f"{len(report.sections.differences)} sections were drawn under rules that differ from "
                "those of the results; each says where."
            )
    versions = sorted({str(row["version"]) for row in report.rows if row.get("version")})
    made = f"Made with SafeStage {__version__}"
    made += f"; results of version {', '.join(versions)}." if versions else "."
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return (
        f'<footer><h2>How to read this</h2><ul>{items}</ul><p class="small">{escape(made)} '
        "The page is complete in itself: it loads nothing and sends nothing.</p></footer>"
    )
