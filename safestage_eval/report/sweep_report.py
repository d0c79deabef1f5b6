"""A sweep for people and programs: table, CSV, JSON, and a plot of the rates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from safestage_eval._text.plural import count
from safestage_eval.errors import InputError
from safestage_eval.metrics import METRICS
from safestage_eval.palette import SERIES
from safestage_eval.rules import RuleSet
from safestage_eval.rules.syntax import amount
from safestage_eval.version import __version__
from safestage_eval.whatif.swept_values import factor_of, like, text_of, unit_name

from .document import Document
from .figure import ready, write
from .summary import share
from .table import Table

if TYPE_CHECKING:
    from safestage_eval.whatif.sweep import Sweep


COLORS = tuple(pair.light for pair in SERIES)

STYLES = ("-", (0, (4, 2)), (0, (1, 1.5)))
"""Line styles, in turn, so that two curves that coincide are both visible."""

DRAWN = {"VR": "violations", "SSR": "safe successes"}
"""The rates that are drawn, in words."""

FEW = 30
"""Number of values up to which each is marked on its curve."""


def render(sweep: Sweep, form: str, by: Sequence[str] = ()) -> str:
    """A sweep in one of the formats table, csv, json."""
    table = Table(
        "",
        (*by, sweep.param, *(f"{metric} %" for metric in METRICS), "inconclusive"),
        [*_rows(sweep, by)],
        len(by) + 1,
    )

    def facts() -> dict[str, Any]:
        return {
            "version": __version__,
            "param": sweep.param,
            "default": amount(sweep.default),
            "rules": list(sweep.readers),
            "curve": sweep.rows(by),
            "flips": sweep.flips(),
            "unread": sweep.unread,
            "problems": [{"path": p.path, "message": p.message} for p in sweep.problems],
        }

    return Document([table], _notes(sweep), "", facts, lambda: sweep.rows(by)).render(form)


def _rows(sweep: Sweep, by: Sequence[str]) -> Iterator[list[str]]:
    """A row for each stretch of values at which nothing changes."""
    for key, cells in sweep.curves(by).items():
        rates = [
            (*(share(cell, metric) for metric in METRICS), str(cell.inconclusive)) for cell in cells
        ]
        for same, stretch in groupby(zip(rates, sweep.values, strict=True), lambda one: one[0]):
            values = [text_of(value) for _, value in stretch]
            yield [*key, " … ".join(dict.fromkeys((values[0], values[-1]))), *same]


def _notes(sweep: Sweep) -> list[str]:
    """Sentences on what was judged, and what was not."""
    notes = [
        f"{sweep.param} is {text_of(sweep.default)} by default and read by "
        f"{', '.join(sweep.readers)}; {len(sweep.values)} values, {count(sweep.count, 'episode')}."
    ]
    if sweep.unread:
        unread = count(sweep.unread, "episode")
        notes.append(f"{unread} left out: no rule assigned to them reads it.")
    return [*notes, *sweep.remarks, *(f"problem: {p.message}" for p in sweep.problems)]


def plot(sweep: Sweep, path: Path, by: Sequence[str] = ()) -> None:
    """Draw VR and SSR against the parameter, its default marked.

    One panel with both, or with groups a panel for each and a colour per group.

    Args:
        sweep: what to draw.
        path: where to; the ending says in which format (png, svg, pdf).
        by: groups.

    Raises:
        InputError: matplotlib is not installed, or cannot write such a file.
    """
    ready("--plot", path)
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    groups = len(sweep.curves(by)) > 1
    size = (9.6, 4.2) if groups else (7.2, 4.2)
    figure, panels = plt.subplots(
        1, 2 if groups else 1, figsize=size, layout="constrained", sharey=True, squeeze=False
    )
    if groups:
        for panel, metric in zip(panels[0], DRAWN, strict=True):
            _draw(panel, sweep, by, (metric,))
            panel.set_title(f"{metric}: {DRAWN[metric]}", loc="left", fontsize=10, pad=18)
    else:
        _draw(panels[0][0], sweep, by, tuple(DRAWN))
    panels[0][0].set_ylabel("share of the decided episodes (%)")
    figure.suptitle(f"Rates against {sweep.param}, read by {', '.join(sweep.readers)}", fontsize=11)
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    write(figure, "--plot", path)


def _draw(axes: Any, sweep: Sweep, by: Sequence[str], metrics: Sequence[str]) -> None:
    """The curves of one panel, with the default and the axes."""
    factor, unit = factor_of(sweep.values[0]), unit_name(sweep.values[0])
    numbers = [amount(value) / factor for value in sweep.values]
    lines = [(key, cells, metric) for key, cells in sweep.curves(by).items() for metric in metrics]
    for i, (key, cells, metric) in enumerate(lines):
        heights = [float("nan") if (v := cell.value(metric)) is None else 100 * v for cell in cells]
        name = ", ".join(key) or f"{metric}: {DRAWN[metric]}"
        axes.plot(
            numbers,
            heights,
            color=COLORS[i % len(COLORS)],
            ls=STYLES[i % len(STYLES)],
            drawstyle="steps-mid",  # rates jump; where between two values is not known
            marker="o" if len(numbers) <= FEW else "",
            ms=4,
            lw=1.8,
            label=f"{name} (N = {max(cell.n for cell in cells)})",
        )
    if unit_name(sweep.default) == unit:
        default = amount(sweep.default) / factor
        axes.axvline(default, color="0.45", lw=1, ls=":")
        axes.annotate(
            f"default {text_of(sweep.default)}",
            (default, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            color="0.35",
            fontsize=9,
        )
    axes.set_xlabel(f"{sweep.param} ({unit})" if unit else sweep.param)
    axes.set_ylim(-3, 103)
    axes.grid(color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


SIDES = ("down", "up")


SLACK_COLUMNS = ("param", "rule", "verdict", "moved", "flips to", "verdicts", "least", "median")


def render_slack(slack: pl.DataFrame, rules: RuleSet, form: str) -> str:
    """Slack per episode, rule and parameter (``whatif.flip_table.slack``) as table, csv, json."""
    undecided = int(slack["verdict"].null_count())
    notes = [f"Left open by the table: {count(undecided, 'verdict')}."] if undecided else []
    rows = [*_slack_rows(slack, rules)] if form == "table" else []
    table = Table("", SLACK_COLUMNS, rows, 5)
    return Document([table], notes, "", slack.to_dicts, slack.to_dicts).render(form)


def _slack_rows(slack: pl.DataFrame, rules: RuleSet) -> Iterator[tuple[str, ...]]:
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
