"""Results as text for people: how many were judged, findings, rates, and what is not in them."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from safestage_eval._text.line_width import folded
from safestage_eval._text.plural import count
from safestage_eval._text.printable import printable, printable_lines
from safestage_eval.metrics import METRICS, Outcome, Rates, by_policy_stage, outcomes, rates
from safestage_eval.metrics.rates import CONDITIONS
from safestage_eval.palette import TERMINAL
from safestage_eval.run.scores import Scores
from safestage_eval.units import format_quantity
from safestage_eval.verdicts import EpisodeResult, Verdict

from .render_text import text_lines
from .summary import coverage, judged, share, summary
from .table import Table

MOST = 40
"""Episodes that are listed one by one; more are only counted unless asked for."""

WIDTH = 100
"""Characters per line where there is no terminal; lines are wrapped, never cut off."""

LEAST = 50
"""Below this the columns leave no room for sentences, and letters would be lost."""

FAILED, REMARK = TERMINAL["violation"], TERMINAL["inconclusive"]
"""Colours of what failed, and of what is to be noted."""

SECTIONS = {
    "violation": ("Violations", TERMINAL["violation"]),
    "inconclusive": ("Inconclusive", TERMINAL["inconclusive"]),
    "not_applicable": ("Not at risk, counted as no violation", TERMINAL["not_applicable"]),
    "pass": ("Safe", TERMINAL["pass"]),
}
"""Outcome of an episode → heading and colour, in this order."""

BAD = ("violation", "inconclusive")
"""Verdicts that are listed even for rules that are not assigned."""

_ORDER = {"violation": 0, "inconclusive": 1, "pass": 2, "not_applicable": 3}


def render(
    scores: Scores, *, width: int | None = None, color: bool = False, everything: bool = False
) -> str:
    """The whole report.

    Args:
        scores: what scoring came to.
        width: of the terminal, in characters.
        color: with terminal colours.
        everything: list every episode, and the findings of rules that are not assigned.
    """
    buffer = io.StringIO()
    console = console_for(buffer, width, color=color)
    every = outcomes(scores.results)
    unreadable = len(scores.problems) + len(scores.aborted)
    put(console, coverage(rates(every), unreadable), "bold")
    console.print()
    _findings(console, scores, everything=everything)
    _unassigned(console, scores, everything=everything)
    if scores.sample:
        put(console, f"{scores.sample}\n", REMARK)
    _rates(console, every)
    _leftovers(console, scores, rates(every))
    _hint(console, scores)
    return "".join(line.rstrip() + "\n" for line in buffer.getvalue().splitlines())


def console_for(buffer: io.StringIO, width: int | None, *, color: bool) -> Console:
    """A console that writes into a buffer, as wide as the terminal; without one, ``WIDTH``."""
    return Console(
        file=buffer, width=max(width or WIDTH, LEAST), color_system="256" if color else None,
        force_terminal=color, no_color=not color, highlight=False, markup=False,
    )  # fmt: skip


def put(console: Console, text: str, style: str = "") -> None:
    """Print lines, folded between words; ids and paths stay whole."""
    for line in folded(text, console.width).split("\n"):
        console.print(Text(line, style), soft_wrap=True)


def by_importance(verdicts: Iterable[Verdict]) -> list[Verdict]:
    """Assigned ones first; among them violations, the earliest first."""
    return sorted(
        verdicts,
        key=lambda v: (not v.assigned, _ORDER[v.verdict], v.time if v.time is not None else 0.0),
    )


def goal_of(result: EpisodeResult) -> str:
    """Native success in words: ``success at 9.62 s``."""
    when = "" if result.success_time is None else f" at {result.success_time:.2f} s"
    texts = {True: f"success{when}", False: "no success", None: "success unknown"}
    return texts[result.success]


def _reached(result: EpisodeResult) -> str:
    """The stage that a rollout without success reached, after a comma; empty if unknown."""
    if result.engagement in (None, "success"):
        return ""
    idle = result.engagement == "idle"
    return ", never reached its target" if idle else f", target {result.engagement}"


def _outcome(result: EpisodeResult) -> str:
    """V of an episode; where nothing was at risk, that: it says nothing of safety."""
    if result.violation is not False:
        return "violation" if result.violation else "inconclusive"
    return "pass" if result.at_risk else "not_applicable"


def _findings(console: Console, scores: Scores, *, everything: bool) -> None:
    counts = dict.fromkeys(SECTIONS, 0)
    listed: dict[str, list[EpisodeResult]] = {outcome: [] for outcome in SECTIONS}
    for result in scores.results:
        if result.assigned:
            outcome = _outcome(result)
            counts[outcome] += 1
            if everything or len(listed[outcome]) < MOST:
                listed[outcome].append(result)
    total = sum(counts.values())
    all_shown = everything or total <= MOST
    left = total if all_shown else MOST
    for outcome, (heading, style) in SECTIONS.items():
        shown = listed[outcome][:left] if all_shown or outcome != "pass" else []
        left -= len(shown)
        if not counts[outcome]:
            continue
        console.print(
            Text(f"{heading}: {counts[outcome]} of {count(total, 'episode')}", f"bold {style}")
        )
        for result in shown:
            head = f"  {result.episode_id}, {goal_of(result)}{_reached(result)}"
            put(console, printable(head), "bold")
            verdicts = result.verdicts if everything else scores.gates.counted(result)
            grid = _grid(verdicts, brief=result.by_roles and not everything)
            console.print(Padding(grid, (0, 0, 0, 4)))
        if len(shown) < counts[outcome]:
            some = "they are" if not shown else f"{counts[outcome] - len(shown)} more are"
            console.print(f"  {some} listed with --verbose, or as rows with --format csv")
        console.print()


def _unassigned(console: Console, scores: Scores, *, everything: bool) -> None:
    """Findings in episodes that no rule is assigned to."""

    def counted(result: EpisodeResult) -> Sequence[Verdict]:
        return result.verdicts if everything else scores.gates.counted(result)

    shown = [
        r for r in scores.results if not r.assigned and any(v.verdict in BAD for v in counted(r))
    ]
    if not shown:
        return
    console.print(Text(f"By rules that are not assigned: {count(len(shown), 'episode')}", "bold"))
    for result in shown if everything else shown[:MOST]:
        put(console, printable(f"  {result.episode_id}, {goal_of(result)}"), "bold")
        console.print(Padding(_grid(counted(result)), (0, 0, 0, 4)))
    if not everything and len(shown) > MOST:
        console.print(f"  {len(shown) - MOST} more are listed with --verbose")
    console.print()


def _hint(console: Console, scores: Scores) -> None:
    """Say how to list the verdicts of rules that no header assigns."""
    words: Counter[str] = Counter(
        v.verdict for r in scores.results if not r.assigned for v in r.verdicts
    )
    if words:
        counts = ", ".join(f"{words[w]} {w.replace('_', ' ')}" for w in _ORDER if w in words)
        put(
            console,
            f"the loaded rules found there: {counts}. --format csv lists all of it, --verbose what "
            "is not safe; --bind assigns rules to episodes",
            REMARK,
        )


def _grid(verdicts: Sequence[Verdict], *, brief: bool = False) -> Grid:
    """The assigned verdicts, and what is not safe among those of ``verdicts``.

    ``brief``: only what is not safe, and a passed rule that had something to judge.
    """
    if brief:
        vacuous = [v for v in verdicts if v.verdict not in BAD and not v.instances]
        verdicts = [v for v in verdicts if v not in vacuous]
    grid = Grid.grid(padding=(0, 2, 0, 0))
    grid.add_column(overflow="fold")
    grid.add_column(no_wrap=True)
    grid.add_column(justify="right", min_width=8)
    grid.add_column(overflow="fold", ratio=1)
    for v in by_importance(verdicts):
        bad = v.verdict in BAD
        if v.assigned or bad:
            at = f"{v.time:.2f} s" if v.verdict == "violation" and v.time is not None else ""
            word = v.verdict.replace("_", " ")
            grid.add_row(
                printable(v.rule),
                Text(word, SECTIONS[v.verdict][1] if v.assigned else ""),
                at,
                Text(printable(" ".join(_sentence(v).split()))),
            )
    if brief and vacuous:
        grid.add_row(
            "", "", "", f"{count(len(vacuous), 'rule')} found nothing to judge (--verbose)"
        )
    return grid


def _sentence(v: Verdict) -> str:
    """The explanation with value and limit; then margin, severity, and why an unassigned rule is listed."""
    facts = []
    if v.margin is not None and v.dimension is not None:
        facts.append(f"margin {format_quantity(v.margin, v.dimension)}")
    if v.severity:
        facts.append(v.severity)
    if not v.assigned:
        facts.append(f"follows {v.consequence_of}" if v.consequence_of else "not assigned")
    sentence = v.explanation or "; ".join(v.notes) or v.title
    return sentence + (f" ({', '.join(facts)})" if facts else "")


def _rates(console: Console, every: Sequence[Outcome]) -> None:
    cells = by_policy_stage(every)
    lines = [*summary(rates(every))]
    for line in lines + [""] * bool(lines):
        console.print(line)
    if not any(cell.n or cell.inconclusive for cell in cells.values()):
        return
    _rate_table(console, "Rates: percent, k/N", cells, None)
    risk = [(cell.given["at risk"]["N"], cell.n) for cell in cells.values()]
    if len(cells) > 1 and any(0 < k < n for k, n in risk):
        _rate_table(console, "Over those at risk: percent, k/N", cells, "at risk")
    if len(cells) > 1:
        _given_table(console, cells)


Cells = Mapping[tuple[str, ...], Rates]


def _given_table(console: Console, cells: Cells) -> None:
    """VR among those that got somewhere, where any is known to have."""
    columns = [name for name in CONDITIONS[1:] if any(c.given[name]["N"] for c in cells.values())]
    if not columns:
        return
    rows = {
        names: [share(cell, "VR", given) for given in columns]
        for names, cell in cells.items()
        if cell.n
    }
    _cells(console, "VR given: percent, k/N", columns, rows)


def _rate_table(console: Console, title: str, cells: Cells, given: str | None) -> None:
    shown = {names: cell for names, cell in cells.items() if cell.n or cell.inconclusive}
    counts = judged(shown.values())
    rows = {
        names: [
            *(write(cell) for write in counts.values()),
            *(share(cell, metric, given) for metric in METRICS),
        ]
        for names, cell in shown.items()
    }
    _cells(console, title, [*counts, *(f"{name} %" for name in METRICS)], rows)


def _cells(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Mapping[tuple[str, ...], Sequence[str]],
) -> None:
    head = ("policy", "prompt", "stage", *columns)
    table = Table(
        title, head, [[*names, *values] for names, values in rows.items()], 3, grouped=True
    )
    first, *rest = text_lines(table, console.width)
    console.print(Text(first, "bold"))
    for line in (*rest, ""):
        console.print(Text(line))


def _leftovers(console: Console, scores: Scores, total: Rates) -> None:
    for line in left_out(total, scores):
        put(console, printable(line), REMARK)
    notes = [f"{r.episode_id}: {note}" for r in scores.results for note in r.notes]
    for line in notes[:MOST]:
        put(console, printable(f"note: {line}"), REMARK)
    if len(notes) > MOST:
        console.print(f"and {len(notes) - MOST} more notes", style=REMARK)
    for line in problem_lines(scores):
        put(console, printable_lines(line), FAILED)
    if scores.problems:
        problems = count(len(scores.problems), "episode")
        console.print(f"{problems} could not be judged", style=f"bold {FAILED}")


def problem_lines(scores: Scores) -> list[str]:
    """Each problem once, with the number of episodes that have the same one."""
    counts = Counter(problem.message for problem in scores.problems)
    return [
        f"problem: {message}" + (f" ({number} episodes)" if number > 1 else "")
        for message, number in counts.items()
    ]


def ended_in_error(ids: Sequence[str]) -> str:
    """Rollouts that were not judged because their recording failed."""
    some = ", ".join(ids[:3]) + ", …" * (len(ids) > 3)
    return (
        f"{count(len(ids), 'rollout')} ended in an error: not judged, not in N; recording "
        f"again tries again: {some}"
    )


def judged_by_roles(scores: Scores) -> str:
    """How many episodes are judged by all rules whose roles are bound; empty if none is."""
    counts = [len(r.assigned) for r in scores.results if r.by_roles]
    if not counts:
        return ""
    least, most = min(counts), max(counts)
    rules = count(most, "rule") if least == most else f"{least} to {count(most, 'rule')}"
    one = len(counts) == 1
    return (
        f"no rule is assigned to {len(counts)} of {count(len(scores.results), 'episode')}: judged "
        "by every "
        f"loaded rule whose roles are bound ({rules}{'' if one else ' each'}); --assign chooses"
    )


def left_out(total: Rates, scores: Scores) -> list[str]:
    """Episodes that are not in N, and how far they could move the rates; those judged by roles."""
    lines = [*filter(None, [judged_by_roles(scores)])]
    bounds = total.bounds("VR")
    if total.inconclusive and bounds is not None:
        low, high = (100 * bound for bound in bounds)
        lines.append(
            f"{total.inconclusive} inconclusive, not in N: whatever they are, VR over all lies "
            f"between {low:.1f} % and {high:.1f} %"
        )
    if total.not_judged:
        missing = sorted({code for r in scores.results for code in r.not_loaded})
        why = (
            f"rules not loaded: {', '.join(missing)}; load their files with --rules, or correct rules in "
            "the header or bind file"
            if missing
            else "no rule is assigned to them, and no loaded rule has bodies for all its roles; name "
            "them with --role target=BODY, or see safestage bind --help"
        )
        lines.append(
            f"{count(total.not_judged, 'episode')} not judged and left out of all rates: {why}"
        )
    if scores.copies:
        lines.append(f"copies of episodes, which count once: {count(len(scores.copies), 'file')}")
    if scores.aborted:
        lines.append(ended_in_error(scores.aborted))
    return lines
