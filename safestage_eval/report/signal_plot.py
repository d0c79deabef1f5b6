"""Signals of one episode as a picture: each with its limits, stretches in violation, and verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval.errors import InputError
from safestage_eval.evidence.intervals import Interval
from safestage_eval.palette import GROUNDS, INKS, SIGNS, VERDICTS, Pair
from safestage_eval.rules import syntax as ast
from safestage_eval.units import format_quantity, in_unit, unit_of
from safestage_eval.verdicts import Verdict
from safestage_eval.verdicts.ask import ask, by_bodies
from safestage_eval.verdicts.curves import Bound, Looked, looked_at
from safestage_eval.verdicts.players import nodes
from safestage_eval.whatif.judge_again import Again

from .figure import ready, write


class Inks:
    """The palette's colours on a light or on a dark ground."""

    def __init__(self, *, dark: bool = False) -> None:

        def of(pair: Pair) -> str:
            return pair.dark if dark else pair.light

        self.ground, self.grid = of(GROUNDS["surface"]), of(INKS["line"])
        self.ink, self.soft, self.goal = map(of, (INKS["ink"], INKS["ink-soft"], INKS["accent"]))
        self.verdicts = {name: of(pair) for name, pair in VERDICTS.items()}
        self.bad = self.verdicts["violation"]


@dataclass(frozen=True, eq=False)
class Panel:
    """One signal.

    Attributes:
        name: with the bodies' names.
        series: (T,) SI.
        limits: of every rule that reads it, each with the rule's code.
        verdicts: of those rules.
    """

    name: str
    series: Interval
    limits: tuple[tuple[Bound, str], ...] = ()
    verdicts: tuple[Verdict, ...] = ()


def panels(
    again: Again,
    expressions: Sequence[str],
    *,
    rule: str | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> list[Panel]:
    """The wanted signals, or those that decide the assigned rules if none is named.

    Args:
        again: the episode, with the rules whose limits are drawn.
        expressions: ``"clearance(target, protected)"``; as verdicts name them works as well, with
            ``since``.
        rule: code of a rule: what decides that one, where no signal is named.
        progress: called with (done, total) signals; total is None at first.

    Raises InputError for a signal, role or body that does not exist, or if nothing decides.
    """
    tell = progress or (lambda _done, _total: None)
    tell(0, None)
    if expressions:
        return _panels(again, expressions, tell)
    judged = again.assigned if rule is None else [again.rules.scoped[rule]]
    decided = [name for one in judged for name in _deciding(again, one)]
    result = _panels(again, list(dict.fromkeys(decided)), tell)
    if not result:
        raise InputError(
            again.episode.header.episode_id,
            "no measurement decides its assigned rules.",
            fix="name a signal, with its bodies or roles",
        )
    return result


def _panels(
    again: Again, names: Sequence[str], tell: Callable[[int, int | None], None]
) -> list[Panel]:
    panels = []
    for name in names:
        panels.append(_panel(again, name))
        tell(len(panels), len(names))
    return panels


def _deciding(again: Again, rule: ast.Scoped) -> list[str]:
    """The signal that decides a rule; where a moment does, those that it is made of."""
    evaluator, verdict = again.evaluator(rule), again.usual(rule)
    if verdict.signal and any(
        curve.signal == verdict.signal
        for _, _, looked in _reading(again, verdict.signal)
        for curve in looked.curves
    ):
        return [verdict.signal]
    if verdict.dimension != "time" or not isinstance(rule, ast.Rule):
        return []
    players = dict(again.binding.players(rule, again.episode.header))
    return [curve.signal for curve in looked_at(evaluator, rule, players, verdict).curves]


def _panel(again: Again, expression: str) -> Panel:
    plain, since, event = expression.partition(" since ")
    rules = again.rules
    declared = (*rules.signals, *rules.derived, *rules.states)
    name = by_bodies(again.episode, plain, declared) + since + event
    series: Interval | None = None
    limits: list[tuple[Bound, str]] = []
    verdicts = []
    for rule, verdict, looked in _reading(again, name):
        for curve in looked.curves:
            if curve.signal == name:
                series = curve.series
                limits += [(bound, rule.code) for bound in curve.limits]
                verdicts.append(verdict)
    if series is None and since:
        raise InputError(
            expression, "no rule that was judged measures it.", fix="leave out 'since'"
        )
    if series is None:
        series = ask(again.episode, name, again.relations, again.rules)
    return Panel(name, series, tuple(limits), tuple(verdicts))


def _reading(again: Again, name: str) -> list[tuple[ast.Rule, Verdict, Looked]]:
    """The rules that read a signal of that name; only the assigned ones if there are any."""
    word = name.partition("(")[0]
    assigned = [rule for rule in again.assigned if isinstance(rule, ast.Rule)]
    for rules in (assigned, [r for r in again.rules.rules.values() if r not in assigned]):
        result = []
        for rule in rules:
            players = dict(again.binding.players(rule, again.episode.header))
            if not all(players.values()) or not _names(again, rule, word):
                continue
            evaluator, verdict = again.evaluator(rule), again.usual(rule)
            looked = looked_at(evaluator, rule, players, verdict)
            if any(curve.signal == name for curve in looked.curves):
                result.append((rule, verdict, looked))
        if result:
            return result
    return []


def _names(again: Again, rule: ast.Rule, word: str) -> bool:
    """The rule, or a state that it names, compares that signal with a limit."""
    states = [
        again.rules.states[node.name]
        for node in nodes(rule)
        if isinstance(node, ast.Call) and node.name in again.rules.states
    ]
    return any(
        isinstance(node, ast.SignalAtom) and node.call.name == word
        for part in (rule, *states)
        for node in nodes(part)
    )


def draw(again: Again, drawn: Sequence[Panel], path: Path, *, dark: bool = False) -> None:
    """Write the picture.

    Args:
        again: the episode.
        drawn: its signals, one below the other.
        path: where to; the ending says in which format (png, svg, pdf).
        dark: for a page with a dark ground.

    Raises:
        InputError: matplotlib is not installed, or cannot write such a file.
    """
    write(figure_of(again, drawn, dark=dark), "--output", path)


def figure_of(again: Again, drawn: Sequence[Panel], *, dark: bool = False) -> Any:
    """A matplotlib figure of signals, one below the other.

    Raises InputError: matplotlib is not installed.
    """
    ready("plot", Path())
    from matplotlib.figure import Figure

    height = 0.9 + 2.1 * len(drawn)
    inks = Inks(dark=dark)
    figure = Figure(figsize=(9.6, height), layout="constrained", facecolor=inks.ground)
    rows = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)
    for axes, panel in zip(rows[:, 0], drawn, strict=True):
        _draw(axes, again, panel, inks)
    rows[-1, 0].set_xlabel("time (s)", color=inks.ink)
    figure.suptitle(again.episode.header.episode_id, fontsize=10, x=0.01, ha="left", color=inks.ink)
    return figure


def _draw(axes: Any, again: Again, panel: Panel, inks: Inks) -> None:
    t = np.asarray(again.episode.t, float)
    dimension = panel.series.dimension

    def shown(value: float) -> float:
        return in_unit(value, dimension)

    lower, upper = panel.series.lower, panel.series.upper
    least = np.isfinite(lower) & ~np.isfinite(upper)
    values = panel.series.value * shown(1.0)
    axes.plot(t, np.where(least, np.nan, values), color=inks.ink, lw=1.3)
    axes.plot(t, np.where(least, values, np.nan), color=inks.soft, lw=1.2, ls=":", label="at least")
    bounds = list(dict.fromkeys((b.value, b.bad, b.param) for b, _ in panel.limits))
    drawn = [*values[np.isfinite(values)], *(shown(value) for value, _, _ in bounds)] or [0.0, 1.0]
    low, high = float(min(drawn)), float(max(drawn))
    pad = 0.08 * (high - low) or max(abs(high), 1.0) * 0.1
    axes.set_ylim(low - pad, high + pad)
    for value, bad, param in bounds:
        at = shown(value)
        axes.axhline(at, color=inks.bad, lw=1.1, ls="--")
        axes.axhspan(
            at, high + pad if bad == "above" else low - pad, color=inks.bad, alpha=0.05, lw=0
        )
        codes = sorted(
            {c for b, c in panel.limits if (b.value, b.bad, b.param) == (value, bad, param)}
        )
        label = f"{', '.join(codes)}: {param or 'limit'} {format_quantity(value, dimension)}"
        axes.annotate(
            label, (0.995, at), xycoords=("axes fraction", "data"), xytext=(0, 3 if bad == "above" else -3),
            textcoords="offset points", ha="right", va="bottom" if bad == "above" else "top",
            color=inks.bad, fontsize=8, bbox={"facecolor": inks.ground, "alpha": 0.75, "linewidth": 0, "pad": 1},
        )  # fmt: skip
    for verdict in panel.verdicts:
        for begin, end in verdict.intervals:
            axes.axvspan(begin, end, color=inks.bad, alpha=0.18, lw=0)
        if verdict.dimension == "time":
            _moment(axes, verdict.value, f"{verdict.signal} begins", inks.bad)
            _moment(axes, verdict.limit, "allowed from here on", inks.verdicts["pass"], line=1)
        if (
            verdict.signal == panel.name
            and verdict.worst_time is not None
            and verdict.value is not None
        ):
            spot, color = (verdict.worst_time, shown(verdict.value)), inks.verdicts[verdict.verdict]
            axes.plot(*spot, "o", color=color, ms=6)
            beside = spot[0] > 0.8 * t[-1] + 0.2 * t[0]
            axes.annotate(
                f"{format_quantity(verdict.value, dimension)} at {verdict.worst_time:.2f} s", spot,
                xytext=(-8 if beside else 8, 0), textcoords="offset points", ha="right" if beside else "left",
                va="center", color=color, fontsize=8.5, fontweight="bold",
                bbox={"facecolor": inks.ground, "alpha": 0.75, "linewidth": 0, "pad": 1},
            )  # fmt: skip
    _moment(axes, again.judge.success_time, "success", inks.goal)
    unit = unit_of(dimension)
    axes.set_title(
        f"{panel.name}{f' ({unit})' if unit else ''}", loc="left", fontsize=9.5, color=inks.ink
    )
    title = "   ".join(
        f"{SIGNS[v.verdict]} {v.rule} {v.verdict.replace('_', ' ')}" for v in panel.verdicts
    )
    if title:
        worst = min(panel.verdicts, key=lambda v: list(SIGNS).index(v.verdict)).verdict
        axes.set_title(title, loc="right", fontsize=9.5, color=inks.verdicts[worst])
    axes.grid(color=inks.grid, lw=0.6, alpha=0.6)
    axes.set_facecolor(inks.ground)
    axes.tick_params(colors=inks.soft)
    axes.spines[["left", "bottom"]].set_color(inks.soft)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _moment(axes: Any, time: float | None, words: str, color: str, line: int = 0) -> None:
    """Mark a moment (s), if there is one; its words in a line of their own, from the top."""
    if time is not None:
        axes.axvline(time, color=color, lw=1, ls=":")
        axes.annotate(
            words, (time, 1), xycoords=("data", "axes fraction"), xytext=(3, -3 - 11 * line),
            textcoords="offset points", va="top", color=color, fontsize=8,
        )  # fmt: skip
