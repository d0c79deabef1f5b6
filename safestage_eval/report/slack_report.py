"""How much slack verdicts have left, for people and programs: table, CSV, JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING

import polars as pl

from safestage_eval._text.plural import count
from safestage_eval.errors import InputError
from safestage_eval.rules import RuleSet
from safestage_eval.whatif.swept_values import like, text_of

from .render_csv import render_csv
from .render_json import render_json
from .render_text import render_text
from .table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator

SIDES = ("down", "up")


COLUMNS = ("param", "rule", "verdict", "moved", "flips to", "verdicts", "least", "median")


def render(slack: pl.DataFrame, rules: RuleSet, form: str) -> str:
    """Slack per episode, rule and parameter (``whatif.flip_table.slack``) as table, csv, json."""
    if form == "csv":
        return render_csv(slack.columns, slack.iter_rows(named=True))
    if form == "json":
        return render_json(slack.to_dicts())
    undecided = int(slack["verdict"].null_count())
    notes = [f"Left open by the table: {count(undecided, 'verdict')}."] if undecided else []
    return render_text([Table("", COLUMNS, list(_rows(slack, rules)), 5)], notes)


def _rows(slack: pl.DataFrame, rules: RuleSet) -> Iterator[tuple[str, ...]]:
    """One row per parameter, rule, verdict and way in which it flips.

    Raises InputError where the rule files are no longer those of the table.
    """
    if gone := sorted(set(slack["param"]) - rules.params.keys()):
        raise InputError(
            "the rule files of the table", f"no longer declare {', '.join(gone)}.",
            fix="score again, with the rules as they are now",
        )  # fmt: skip
    for side in SIDES:
        keys = ["param", "rule", "verdict", f"to_{side}"]
        groups = (
            slack.filter(pl.col(side).is_not_null())
            .group_by(keys)
            .agg(pl.len(), pl.col(side).min().alias("least"), pl.col(side).median().alias("median"))
            .sort(keys)
        )
        for row in groups.iter_rows(named=True):
            usual = rules.params[row["param"]]
            sizes = [text_of(like(usual, row[name])) for name in ("least", "median")]
            yield (
                row["param"], row["rule"], row["verdict"], side, row[f"to_{side}"],
                str(row["len"]), *sizes,
            )  # fmt: skip
