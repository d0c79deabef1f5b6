"""The rules that were violated most, each with the way to its episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any
from urllib.parse import quote

SHOWN = 12
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
    body = "".join(_row(rule, found[rule], titles.get(rule, ""), most) for rule in broken[:SHOWN])
    more = len(broken) - SHOWN
    return (
        '<section id="rules" aria-labelledby="rules-title"><h2 id="rules-title">Rules broken most</h2>'
        '<div class="scroll" tabindex="0" role="region" aria-label="Rules broken most"><table class="results rules">'
        '<thead><tr><th scope="col">Rule</th><th scope="col">Asks</th><th scope="col" class="amount">Violated</th>'
        '<th scope="col"><span class="visually-hidden">Share</span></th>'
        f'<th scope="col" class="amount">Undecided</th></tr></thead><tbody>{body}</tbody></table></div>'
        + (f'<p class="small soft">{more} more rules were violated.</p>' if more > 0 else "")
        + "</section>"
    )


def _row(rule: str, counts: Counter[str], title: str, most: int) -> str:
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
