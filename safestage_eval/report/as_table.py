"""Results as text for people: findings first, then the rates, then what could not be judged."""

from __future__ import annotations

import io
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from safestage_eval.metrics import Rates, by_policy_stage, outcomes, rates
from safestage_eval.score import Scores
from safestage_eval.units import format_quantity
from safestage_eval.verdicts import EpisodeResult, Verdict

MOST = 60
"""Episodes that are listed one by one; more are only counted unless asked for."""

STYLES = {
    "violation": "bold red",
    "pass": "green",
    "inconclusive": "yellow",
    "not_applicable": "dim",
}


def render(
    scores: Scores, *, width: int | None = None, color: bool = False, everything: bool = False
) -> str:
    """The whole report.

    Args:
        scores: what scoring came to.
        width: of the terminal, in characters; nothing is cut off if None.
        color: with terminal colours.
        everything: list every episode, and the findings of rules that are not assigned.
    """
    buffer = io.StringIO()
    console = Console(
        file=buffer, width=width or 160, force_terminal=color, no_color=not color, highlight=False
    )
    judged = [r for r in scores.results if r.assigned]
    if len(judged) <= MOST or everything:
        console.print(_episodes(judged))
    else:
        shown = [r for r in judged if r.violation is not False][:MOST]
        console.print(_episodes(shown))
        console.print(
            f"{len(shown)} of {len(judged)} judged episodes shown, violations first; "
            "all with --verbose, or as rows with --format csv"
        )
    if everything:
        _others(console, scores.results)
    console.print(_rates(scores))
    _leftovers(console, scores)
    return buffer.getvalue()


def number(value: float | None, verdict: Verdict) -> str:
    """A value or limit of a verdict with its unit; a dash where it has none."""
    if value is None or verdict.dimension is None:
        return "–"
    return format_quantity(value, verdict.dimension)


def decisive(result: EpisodeResult) -> Verdict:
    """The assigned verdict that stands for the episode: the earliest violation, else the closest."""
    order = {"violation": 0, "inconclusive": 1, "pass": 2, "not_applicable": 3}
    return min(
        result.assigned,
        key=lambda v: (
            order[v.verdict],
            v.time if v.time is not None else float("inf"),
            v.margin_normalised if v.margin_normalised is not None else float("inf"),
        ),
    )


def _episodes(results: Sequence[EpisodeResult]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Episodes", title_justify="left")
    for name in ("task", "policy", "seed"):
        table.add_column(name, overflow="fold")
    table.add_column("success")
    table.add_column("rule")
    table.add_column("verdict")
    table.add_column("at", justify="right")
    table.add_column("what", overflow="fold")
    table.add_column("value", justify="right")
    table.add_column("limit", justify="right")
    for result in results:
        v = decisive(result)
        bad = v.verdict == "violation"
        success = {True: "yes", False: "no", None: "?"}[result.success]
        table.add_row(
            result.task or result.episode_id,
            " ".join(filter(None, (result.policy, result.prompt))),
            "–" if result.seed is None else str(result.seed),
            success,
            v.rule,
            Text(v.verdict, style=STYLES[v.verdict]),
            f"{v.time:.2f} s" if bad and v.time is not None else "",
            v.signal or "",
            number(v.value, v),
            number(v.limit, v),
        )
    return table


def _others(console: Console, results: Sequence[EpisodeResult]) -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Other findings", title_justify="left")
    for name in ("episode", "rule", "at", "what"):
        table.add_column(name, overflow="fold")
    for result in results:
        for v in result.verdicts:
            if not v.assigned and v.verdict == "violation":
                after = f" (follows {v.consequence_of})" if v.consequence_of else ""
                at = "" if v.time is None else f"{v.time:.2f} s"
                table.add_row(result.episode_id, v.rule, at, v.explanation + after)
    if table.row_count:
        console.print(table)


def _rates(scores: Scores) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Rates", title_justify="left")
    for name in ("policy", "prompt", "stage"):
        table.add_column(name, overflow="fold")
    for name in ("SR", "SSR", "USR", "VR"):
        table.add_column(name, justify="right")
    for (policy, prompt, stage), cell in by_policy_stage(outcomes(scores.results)).items():
        if cell.n or cell.inconclusive:
            table.add_row(
                policy, prompt, stage, *(rate(cell, m) for m in ("SR", "SSR", "USR", "VR"))
            )
    return table


def rate(cell: Rates, metric: str) -> str:
    """``66.7 %  4/6``; a dash when N is 0."""
    value = cell.value(metric)
    return "–" if value is None else f"{100 * value:5.1f} %  {cell.count(metric)}/{cell.n}"


def _leftovers(console: Console, scores: Scores) -> None:
    total = rates(outcomes(scores.results))
    if total.inconclusive and total.violation_bounds:
        low, high = total.violation_bounds
        console.print(
            f"{total.inconclusive} inconclusive, not in N: VR lies between "
            f"{100 * low:.1f} % and {100 * high:.1f} % whatever they are"
        )
    if total.not_judged:
        console.print(
            f"{total.not_judged} not judged: their assigned rules are not among the loaded ones"
        )
    for result in scores.results:
        for note in result.notes:
            if "not judged" not in note:
                console.print(f"{result.episode_id}: {note}", style="yellow", soft_wrap=True)
        for v in result.assigned:
            if v.verdict == "inconclusive":
                console.print(
                    f"{result.episode_id}: {v.rule}: {v.explanation}",
                    style="yellow",
                    soft_wrap=True,
                )
    for problem in scores.problems:
        console.print(f"problem: {problem.message}", style="red", soft_wrap=True)
