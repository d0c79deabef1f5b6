"""Flipped verdicts and moved rates, for people and programs."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from safestage_eval._text.plural import count
from safestage_eval.version import __version__

from .document import Document
from .table import Table

if TYPE_CHECKING:
    from safestage_eval.whatif.result_difference import Difference, Flip


def render(difference: Difference, form: str) -> str:
    """A difference as table or json."""
    tables = []
    for rule, flips in difference.by_rule().items():
        kinds = Counter(map(_change, flips))
        title = f"{rule}: {', '.join(f'{number} {kind}' for kind, number in kinds.items())}"
        rows = [[f"  {f.episode_id}", _change(f), _margins(f), f.cause] for f in flips]
        tables.append(Table(title, (), rows, 4))
    if difference.rates:
        columns = ("policy", "prompt", "stage", "rate", "before", "after")
        moved = []
        for r in difference.rates:
            ends = zip((r.before, r.after), r.counts, strict=True)
            shown = ["–" if v is None else f"{100 * v:.1f} % {k}/{n}" for v, (k, n) in ends]
            moved.append([r.policy, r.prompt, r.stage, r.metric, *shown])
        tables.append(Table("", columns, moved, 4))
    return Document(tables, _notes(difference), facts=lambda: _facts(difference)).render(form)


def _notes(difference: Difference) -> list[str]:
    """Count the flips, and list what could not be compared."""
    flips, same = len(difference.flips), difference.same
    lines = [f"{flips} of {count(flips + same, 'verdict')} flipped"]
    for where, pairs in (("before", difference.only_before), ("after", difference.only_after)):
        if pairs:
            rules = ", ".join(sorted({rule for _, rule in pairs}))
            lines.append(f"only {where}: {count(len(pairs), 'verdict')} ({rules})")
    return lines + [f"problem: {message}" for message in difference.problems]


def _facts(difference: Difference) -> dict[str, Any]:
    flips = []
    for flip in map(asdict, difference.flips):
        flip["margin_before"], flip["margin_after"] = flip.pop("margins")
        flip["unit_before"], flip["unit_after"] = flip.pop("units")
        flips.append(flip)
    return {
        "version": __version__,
        "flips": flips,
        "rates": [asdict(rate) for rate in difference.rates],
        "same": difference.same,
        "only_before": [list(pair) for pair in difference.only_before],
        "only_after": [list(pair) for pair in difference.only_after],
        "problems": list(difference.problems),
    }


def _change(flip: Flip) -> str:
    return f"{flip.before} → {flip.after}".replace("_", " ")


def _margins(flip: Flip) -> str:
    if flip.margins == (None, None):
        return ""
    return " → ".join(
        "–" if margin is None else f"{margin:.4g} {unit or ''}".rstrip()
        for margin, unit in zip(flip.margins, flip.units, strict=True)
    )
