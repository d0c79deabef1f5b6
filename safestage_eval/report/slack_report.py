"""How much slack verdicts have left, for people and programs: table, CSV, JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING

import polars as pl

from safestage_eval.rules import RuleSet
from safestage_eval.whatif.flip_lasting import like
from safestage_eval.whatif.values import text_of

from .render_text import render_text
from .table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator

FORMATS = ("table", "csv", "json")

SIDES = ("down", "up")


def render(found: pl.DataFrame, rules: RuleSet, form: str) -> str:
    """Slack per episode, rule and parameter (``whatif.flip_query.slack``) in one of ``FORMATS``."""
    if form == "csv":
        return found.write_csv()
    if form == "json":
        return found.write_json() + "\n"
    head = ("param", "rule", "verdict", "moved", "flips to", "verdicts", "least", "median")
    left = int(found["verdict"].null_count())
    said = [f"{left} verdicts are left open by the table."] if left else []
    return render_text([Table("", head, list(_rows(found, rules)), 5)], said)


def _rows(found: pl.DataFrame, rules: RuleSet) -> Iterator[tuple[str, ...]]:
    """One row per parameter, rule, verdict and way in which it flips."""
    for side in SIDES:
        keys = ["param", "rule", "verdict", f"to_{side}"]
        told = (
            found.filter(pl.col(side).is_not_null())
            .group_by(keys)
            .agg(pl.len(), pl.col(side).min().alias("least"), pl.col(side).median().alias("median"))
            .sort(keys)
        )
        for row in told.iter_rows(named=True):
            usual = rules.params[row["param"]]
            sizes = [text_of(like(usual, row[name])) for name in ("least", "median")]
            yield (
                row["param"], row["rule"], row["verdict"], side, row[f"to_{side}"],
                str(row["len"]), *sizes,
            )  # fmt: skip
