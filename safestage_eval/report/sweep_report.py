"""A sweep for people and programs: table, CSV, JSON, and a plot of the rates."""

from __future__ import annotations

from collections.abc import Sequence
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

from .figure import ready, write
from .render_csv import render_csv
from .render_json import render_json
from .render_text import render_text
from .summary import share
from .table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator

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
    return {"table": _table, "csv": _csv, "json": _json}[form](sweep, by)


def _table(sweep: Sweep, by: Sequence[str]) -> str:
    """Values at which nothing changes are drawn together into one line."""
    head = (*by, sweep.param, *(f"{metric} %" for metric in METRICS), "inconclusive")
    rows = []
    for key, cells in sweep.curves(by).items():
        shown = [[share(cell, metric) for metric in METRICS] for cell in cells]
        facts = [[*r, str(c.inconclusive)] for r, c in zip(shown, cells, strict=True)]
        first = 0
        for i in range(1, len(facts) + 1):
            if i == len(facts) or facts[i] != facts[first]:
                ends = [text_of(sweep.values[first]), text_of(sweep.values[i - 1])]
                rows.append([*key, " … ".join(dict.fromkeys(ends)), *facts[first]])
                first = i
    return render_text([Table("", head, rows, len(by) + 1)], _remarks(sweep))


def _remarks(sweep: Sweep) -> list[str]:
    """Sentences on what was judged, and what was not."""
    remarks = [
        f"{sweep.param} is {text_of(sweep.default)} by default and read by "
        f"{', '.join(sweep.readers)}; {len(sweep.values)} values, {count(sweep.count, 'episode')}."
    ]
    if sweep.unread:
        remarks.append(
            f"{count(sweep.unread, 'episode')} left out: no rule assigned to them reads it."
        )
    remarks += sweep.remarks
    return remarks + [f"problem: {problem.message}" for problem in sweep.problems]


def _csv(sweep: Sweep, by: Sequence[str]) -> str:
    rows = sweep.rows(by)
    return render_csv(list(rows[0]) if rows else [], rows)


def _json(sweep: Sweep, by: Sequence[str]) -> str:
    document: dict[str, Any] = {
        "version": __version__,
        "param": sweep.param,
        "default": amount(sweep.default),
        "rules": list(sweep.readers),
        "curve": sweep.rows(by),
        "flips": sweep.flips(),
        "unread": sweep.unread,
        "problems": [{"path": p.path, "message": p.message} for p in sweep.problems],
    }
    return render_json(document)


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
    if form == "csv":
        return render_csv(slack.columns, slack.iter_rows(named=True))
    if form == "json":
        return render_json(slack.to_dicts())
    undecided = int(slack["verdict"].null_count())
    notes = [f"Left open by the table: {count(undecided, 'verdict')}."] if undecided else []
    return render_text([Table("", SLACK_COLUMNS, list(_slack_rows(slack, rules)), 5)], notes)


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
