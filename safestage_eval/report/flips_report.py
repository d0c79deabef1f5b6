"""Flipped verdicts and moved rates, for people and programs."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from safestage_eval.version import __version__

if TYPE_CHECKING:
    from safestage_eval.whatif.results import Difference, Flip, RateChange

FORMATS = ("table", "json", "csv", "markdown")

COLUMNS = (
    "episode_id", "rule", "assigned", "before", "after", "margin_before", "unit_before",
    "margin_after", "unit_after", "signal", "cause",
)  # fmt: skip


def render(found: Difference, form: str) -> str:
    """A difference in one of ``FORMATS``. Raises KeyError for another."""
    return {"table": _table, "json": _json, "csv": _csv, "markdown": _markdown}[form](found)


def _table(found: Difference) -> str:
    lines = []
    for rule, flips in found.by_rule().items():
        lines.append(f"{rule}: {_counted(flips)}")
        rows = [[f"  {f.episode_id}", _change(f), _margins(f), f.cause] for f in flips]
        lines += [*_columns(rows), ""]
    if found.rates:
        rows = [["policy", "prompt", "stage", "rate", "before", "after"]]
        rows += [[r.policy, r.prompt, r.stage, r.metric, *_rate(r)] for r in found.rates]
        lines += [*_columns(rows), ""]
    return "\n".join([*lines, *_summary(found)]) + "\n"


def _markdown(found: Difference) -> str:
    lines = []
    if found.flips:
        lines += [
            "| rule | episode | verdict | margin | because |",
            "|---|---|---|---|---|",
            *(
                f"| {f.rule} | `{f.episode_id}` | {_change(f)} | {_margins(f)} | {_cell(f.cause)} |"
                for f in found.flips
            ),
            "",
        ]
    if found.rates:
        lines += [
            "| policy | prompt | stage | rate | before | after |",
            "|---|---|---|---|---:|---:|",
            *(
                f"| {_cell(r.policy)} | {_cell(r.prompt)} | {r.stage} | {r.metric} | "
                + " | ".join(_rate(r))
                + " |"
                for r in found.rates
            ),
            "",
        ]
    return "\n".join([*lines, *(f"- {line}" for line in _summary(found))]) + "\n"


def _csv(found: Difference) -> str:
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for flip in found.flips:
        row = _facts(flip)
        writer.writerow({**{n: row[n] for n in COLUMNS}, "assigned": str(flip.assigned).lower()})
    return buffer.getvalue()


def _json(found: Difference) -> str:
    document = {
        "version": __version__,
        "flips": [_facts(flip) for flip in found.flips],
        "rates": [asdict(rate) for rate in found.rates],
        "same": found.same,
        "only_before": [list(pair) for pair in found.only_before],
        "only_after": [list(pair) for pair in found.only_after],
        "problems": list(found.problems),
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _facts(flip: Flip) -> dict[str, Any]:
    facts = asdict(flip)
    facts["margin_before"], facts["margin_after"] = facts.pop("margins")
    facts["unit_before"], facts["unit_after"] = facts.pop("units")
    return facts


def _summary(found: Difference) -> list[str]:
    """What changed in one line, and what could not be compared."""
    flips, same = len(found.flips), found.same
    lines = [f"{flips} of {_count(flips + same, 'verdict')} flipped"]
    for where, pairs in (("before", found.only_before), ("after", found.only_after)):
        if pairs:
            rules = ", ".join(sorted({rule for _, rule in pairs}))
            lines.append(f"only {where}: {_count(len(pairs), 'verdict')} ({rules})")
    return lines + [f"problem: {message}" for message in found.problems]


def _counted(flips: Sequence[Flip]) -> str:
    kinds = Counter(_change(flip) for flip in flips)
    return ", ".join(f"{count} {kind}" for kind, count in kinds.items())


def _change(flip: Flip) -> str:
    return f"{flip.before} → {flip.after}".replace("_", " ")


def _margins(flip: Flip) -> str:
    if flip.margins == (None, None):
        return ""
    return " → ".join(
        "–" if margin is None else f"{margin:.4g} {unit or ''}".rstrip()
        for margin, unit in zip(flip.margins, flip.units, strict=True)
    )


def _rate(change: RateChange) -> tuple[str, str]:
    before, after = (
        "–" if value is None else f"{100 * value:.1f} % {k}/{n}"
        for value, (k, n) in zip((change.before, change.after), change.counts, strict=True)
    )
    return before, after


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return [
        "  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    ]
