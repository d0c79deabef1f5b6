"""Flipped verdicts and moved rates, for people and programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from safestage_eval._text.plural import count
from safestage_eval.version import __version__

from .render_json import render_json
from .render_text import render_text
from .table import Table

if TYPE_CHECKING:
    from safestage_eval.whatif.result_difference import Difference, Flip, RateChange


def render(difference: Difference, form: str) -> str:
    """A difference as table or json."""
    return {"table": _table, "json": _json}[form](difference)


def _table(difference: Difference) -> str:
    tables = [
        Table(
            f"{rule}: {_counted(flips)}",
            (),
            [[f"  {f.episode_id}", _change(f), _margins(f), f.cause] for f in flips],
            4,
        )
        for rule, flips in difference.by_rule().items()
    ]
    return render_text([*tables, *_rates(difference)], _summary(difference))


def _rates(difference: Difference) -> list[Table]:
    if not difference.rates:
        return []
    columns = ("policy", "prompt", "stage", "rate", "before", "after")
    rows = [[r.policy, r.prompt, r.stage, r.metric, *_rate(r)] for r in difference.rates]
    return [Table("", columns, rows, 4)]


def _json(difference: Difference) -> str:
    document = {
        "version": __version__,
        "flips": [_facts(flip) for flip in difference.flips],
        "rates": [asdict(rate) for rate in difference.rates],
        "same": difference.same,
        "only_before": [list(pair) for pair in difference.only_before],
        "only_after": [list(pair) for pair in difference.only_after],
        "problems": list(difference.problems),
    }
    return render_json(document)


def _facts(flip: Flip) -> dict[str, Any]:
    facts = asdict(flip)
    facts["margin_before"], facts["margin_after"] = facts.pop("margins")
    facts["unit_before"], facts["unit_after"] = facts.pop("units")
    return facts


def _summary(difference: Difference) -> list[str]:
    """Count the flips, and list what could not be compared."""
    flips, same = len(difference.flips), difference.same
    lines = [f"{flips} of {count(flips + same, 'verdict')} flipped"]
    for where, pairs in (("before", difference.only_before), ("after", difference.only_after)):
        if pairs:
            rules = ", ".join(sorted({rule for _, rule in pairs}))
            lines.append(f"only {where}: {count(len(pairs), 'verdict')} ({rules})")
    return lines + [f"problem: {message}" for message in difference.problems]


def _counted(flips: Sequence[Flip]) -> str:
    kinds = Counter(_change(flip) for flip in flips)
    return ", ".join(f"{number} {kind}" for kind, number in kinds.items())


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
