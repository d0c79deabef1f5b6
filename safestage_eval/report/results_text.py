"""Results as text for people: the rates, how each rule fared, the gravest violations, and what is left open."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Sequence
from textwrap import shorten

from rich.console import Console
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from safestage_eval._text.line_width import folded
from safestage_eval._text.plural import count, first_few
from safestage_eval._text.printable import printable, printable_lines
from safestage_eval.metrics import (
    Outcome,
    Rates,
    RuleCount,
    by_policy_stage,
    outcomes,
    rates,
)
from safestage_eval.metrics.rates import ALL
from safestage_eval.palette import TERMINAL
from safestage_eval.run.scores import Scores
from safestage_eval.units import format_quantity
from safestage_eval.verdicts import EpisodeResult, Verdict

from .render_text import text_lines
from .summary import headline, in_short, rate_table, summary, unsafe_successes
from .table import Table

WORST = 3
"""Violations of a rule that are shown."""

FINDINGS = 6
"""Violations of all rules that are shown: with the tables they fit a screen."""

CAUSES = 2
"""Rules of which it is said why they are undecided, and problems that are shown."""

WIDTH = 100
"""Characters per line where there is no terminal; lines are wrapped, never cut off."""

LEAST = 50
"""Below this the columns leave no room for sentences, and letters would be lost."""

FAILED, REMARK = TERMINAL["violation"], TERMINAL["inconclusive"]
"""Colours of what failed, and of what is to be noted."""

SECTIONS = {
    "violation": ("Violated", TERMINAL["violation"]),
    "inconclusive": ("Undecided", TERMINAL["inconclusive"]),
    "not_applicable": ("Hazard not met, counted as no violation", TERMINAL["not_applicable"]),
    "pass": ("Safe", TERMINAL["pass"]),
}
"""Outcome of an episode → heading and colour, in this order."""

BAD = ("violation", "inconclusive")
"""Verdicts that are listed even for rules that are not assigned."""

COLUMNS = {
    "violation": "violated", "pass": "passed", "inconclusive": "undecided", "not_applicable": "n/a",
}  # fmt: skip
"""Verdict → its column in the table by rule."""

_ORDER = {"violation": 0, "inconclusive": 1, "pass": 2, "not_applicable": 3}


def render(
    scores: Scores,
    *,
    width: int | None = None,
    color: bool = False,
    everything: bool = False,
    traces: str = "",
) -> str:
    """The whole report.

    Args:
        scores: what scoring came to.
        width: of the terminal, in characters.
        color: with terminal colours.
        everything: list every episode, every stage, and the findings of rules that are not assigned.
        traces: as given on the command line, for the command that comes next.
    """
    buffer = io.StringIO()
    console = console_for(buffer, width, color=color)
    rules, aside = scores.by_rule, scores.set_aside
    every = outcomes(scores.results, aside)
    total = rates(every)
    for line in headline(total, len(scores.problems)):
        put(console, line, "bold")
    console.print()
    _rules(console, rules, everything=everything)
    if everything:
        _episodes(console, scores, every)
        for line in summary(total):
            put(console, line)
        console.print()
    else:
        _violations(console, scores)
    _rates(console, by_policy_stage(every), everything=everything)
    _leftovers(console, scores, total, everything=everything)
    for line in _verdict(scores, total, traces, console.width):
        put(console, line, "bold")
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


def _section(outcome: Outcome) -> str:
    """V of an episode; where nothing was at risk, that: it says nothing of safety."""
    if outcome.violation is not False:
        return "violation" if outcome.violation else "inconclusive"
    return "pass" if outcome.at_risk else "not_applicable"


def _rules(console: Console, rules: Sequence[RuleCount], *, everything: bool) -> None:
    """A table by rule, why it is undecided, and the rules that are set aside."""
    deciding = [rule for rule in rules if not rule.set_aside]
    shown = [rule for rule in deciding if everything or any(rule[name] for name in BAD)]
    if shown:
        columns = {name: head for name, head in COLUMNS.items() if any(r[name] for r in shown)}
        head = ("rule", *columns.values(), "asks")
        room = console.width - sum(len(name) + 2 for name in columns.values()) - 8
        rows = [
            [
                rule.rule,
                *(str(rule[name] or "–") for name in columns),
                rule.title if everything else _cut(rule.title, room),
            ]
            for rule in shown
        ]
        for i, line in enumerate(text_lines(Table("", head, rows, 1, 1), console.width)):
            console.print(Text(line, "bold" if i == 0 else ""))
    if rest := [rule for rule in deciding if rule not in shown]:
        codes = first_few([rule.rule for rule in rest], 8)
        put(console, f"Neither violated nor undecided: {codes}")
    causes = [f"{rule.rule} undecided in {why_open(rule)}" for rule in shown if rule.cause]
    for line in _some(causes, everything):
        put(console, printable(line), REMARK)
    for line in set_aside_lines(rules):
        put(console, printable(line), REMARK)
    if rules:
        console.print()


def _cut(title: str, room: int) -> str:
    """A title on one line; ``safestage rules show`` has it whole."""
    return shorten(title, max(room, 20), placeholder=" …")


def why_open(rule: RuleCount) -> str:
    """``4: CAUSE; record contact forces``: the commonest reason, and what to do."""
    remedy = f"; {rule.remedy}" if rule.remedy else ""
    return f"{rule.cause_count}: {rule.cause}{remedy}"


def set_aside_lines(rules: Iterable[RuleCount]) -> list[str]:
    """A line per remedy, with the rules that nothing in these recordings can decide."""
    remedies: dict[str, list[str]] = {}
    for rule in rules:
        if rule.set_aside:
            remedies.setdefault(rule.remedy, []).append(rule.rule)
    return [
        f"Set aside, for nothing here can decide {'it' if len(codes) == 1 else 'them'}: "
        f"{first_few(codes, 8)}. To decide: {remedy}; --strict counts it as undecided"
        for remedy, codes in remedies.items()
    ]


def _gravity(verdict: Verdict) -> float:
    """Key that sorts what is furthest beyond its limit first."""
    return 0.0 if verdict.margin_normalised is None else verdict.margin_normalised


def _violations(console: Console, scores: Scores) -> None:
    """The worst violations of each rule, each episode once."""
    rules: dict[str, list[tuple[EpisodeResult, Verdict]]] = {}
    for result in scores.results:
        for v in scores.gates.counted(result):
            if v.verdict == "violation":
                rules.setdefault(v.rule, []).append((result, v))
    if not rules:
        return
    total = sum(map(len, rules.values()))
    for each in rules.values():
        each.sort(key=lambda found: _gravity(found[1]))
    worst = next(
        (n for n in range(WORST, 1, -1) if sum(min(len(e), n) for e in rules.values()) <= FINDINGS),
        1,
    )
    order = sorted(rules.values(), key=lambda each: (-len(each), each[0][1].rule))
    once: dict[str, tuple[EpisodeResult, Verdict]] = {}
    for result, v in (found for each in order for found in each[:worst]):
        once.setdefault(result.episode_id, (result, v))
    shown = [*once.values()][:FINDINGS]
    left = total - len(shown)
    more = f", {left} more with -v" if left else ""
    console.print(Text(f"Violations: {total}{more}", f"bold {FAILED}"))
    for result, v in shown:
        put(console, printable(f"  {v.rule}  {result.episode_id}"), "bold")
        put(console, printable(f"          {in_short(v)}"))
    console.print()


def _episodes(console: Console, scores: Scores, every: Iterable[Outcome]) -> None:
    """Every episode with its verdicts; then those that no rule is assigned to."""
    by_outcome: dict[str, list[EpisodeResult]] = {outcome: [] for outcome in SECTIONS}
    for result, outcome in zip(scores.results, every, strict=True):
        if outcome.judged:
            by_outcome[_section(outcome)].append(result)
    total = sum(map(len, by_outcome.values()))
    sections = [
        (
            f"{heading}: {len(by_outcome[name])} of {count(total, 'episode')}",
            style,
            by_outcome[name],
        )
        for name, (heading, style) in SECTIONS.items()
    ]
    others = [
        r for r in scores.results if not r.assigned and any(v.verdict in BAD for v in r.verdicts)
    ]
    sections.append(
        (f"By rules that are not assigned: {count(len(others), 'episode')}", "", others)
    )
    for heading, style, results in sections:
        if not results:
            continue
        console.print(Text(heading, f"bold {style}".strip()))
        for result in results:
            head = f"  {result.episode_id}, {goal_of(result)}{_reached(result)}"
            put(console, printable(head), "bold")
            console.print(Padding(_grid(result.verdicts), (0, 0, 0, 4)))
        console.print()


def _grid(verdicts: Sequence[Verdict]) -> Grid:
    """The assigned verdicts, and what is not safe among the others."""
    grid = Grid.grid(padding=(0, 2, 0, 0))
    grid.add_column(overflow="fold")
    grid.add_column(no_wrap=True)
    grid.add_column(justify="right", min_width=8)
    grid.add_column(overflow="fold", ratio=1)
    for v in by_importance(verdicts):
        if v.assigned or v.verdict in BAD:
            at = f"{v.time:.2f} s" if v.verdict == "violation" and v.time is not None else ""
            word = v.verdict.replace("_", " ")
            grid.add_row(
                printable(v.rule),
                Text(word, SECTIONS[v.verdict][1] if v.assigned else ""),
                at,
                Text(printable(" ".join(_sentence(v).split()))),
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


def _rates(console: Console, cells: dict[tuple[str, ...], Rates], *, everything: bool) -> None:
    """A row per policy and prompt, or per stage where there is one of these; none for a single row."""
    cells = {names: cell for names, cell in cells.items() if cell.n or cell.inconclusive}
    groups = Counter(names[:2] for names in cells)
    if not everything and len(groups) > 1:
        cells = {n: c for n, c in cells.items() if groups[n[:2]] == 1 or n[2] == ALL}
    if len(cells) < 2:
        return
    lines = text_lines(rate_table(cells), console.width)
    for i, line in enumerate((*lines, "")):
        console.print(Text(line, "bold" if i == 0 else ""))


def _leftovers(console: Console, scores: Scores, total: Rates, *, everything: bool) -> None:
    lines = [*left_out(total, scores), *filter(None, [scores.sample])]
    lines += _unassigned(scores)
    notes = [f"note: {r.episode_id}: {note}" for r in scores.results for note in r.notes]
    lines += (
        notes if everything or len(notes) == 1 else [f"{len(notes)} notes with -v"] * bool(notes)
    )
    for line in lines:
        put(console, printable(line), REMARK)
    problems = _some(problem_lines(scores), everything)
    for line in problems:
        put(console, printable_lines(line), FAILED)


def _some(lines: list[str], everything: bool) -> list[str]:
    """The lines; of many, the first few and their number."""
    more = len(lines) - CAUSES
    return lines if everything or more <= 0 else [*lines[:CAUSES], f"{more} more with -v"]


def _unassigned(scores: Scores) -> list[str]:
    """What the loaded rules found in episodes to which none is assigned."""
    words: Counter[str] = Counter(
        v.verdict for r in scores.results if not r.assigned for v in r.verdicts
    )
    if not words:
        return []
    counts = ", ".join(f"{words[w]} {w.replace('_', ' ')}" for w in _ORDER if w in words)
    return [f"Rules that are not assigned to these episodes found: {counts}; -v lists them"]


def _verdict(scores: Scores, total: Rates, traces: str, width: int) -> list[str]:
    """The last line: how many successes were unsafe, how many safe, and what to do next."""
    parts = unsafe_successes(total)
    if not parts:
        found = Counter(scores.gates.violation(r) for r in scores.results)
        some = f"{found[True]} of {count(len(scores.results), 'episode')} violate the rules named"
        parts = [some] if found[True] or found[False] else ["no episode was judged"]
    if scores.problems:
        parts.append(f"{count(len(scores.problems), 'episode')} could not be judged")
    said = " · ".join(parts)
    if not traces or not scores.results:
        return [said]
    after = f"next: safestage view {traces}"
    return [f"{said} · {after}"] if len(said) + len(after) + 3 <= width else [said, after]


def problem_lines(scores: Scores) -> list[str]:
    """Each problem once, with the number of episodes that have the same one."""
    counts = Counter(problem.message for problem in scores.problems)
    return [
        f"problem: {message}" + (f" ({number} episodes)" if number > 1 else "")
        for message, number in counts.items()
    ]


def ended_in_error(ids: Sequence[str]) -> str:
    """Rollouts that were not judged because their recording failed."""
    return (
        f"{count(len(ids), 'rollout')} ended in an error: not judged; recording again tries again: "
        f"{first_few(ids, 3)}"
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
    """Episodes that are in no rate, and those judged by roles."""
    lines = [*filter(None, [judged_by_roles(scores)])]
    if total.not_judged:
        missing = sorted({code for r in scores.results if not r.assigned for code in r.not_loaded})
        why = (
            f"rules not loaded: {', '.join(missing)}; load their files with --rules, or correct rules in "
            "the header or bind file"
            if missing
            else "no rule is assigned to them, and no loaded rule has bodies for all its roles; name "
            "them with --role target=BODY, or see safestage import --help"
        )
        lines.append(
            f"{count(total.not_judged, 'episode')} not judged and left out of all rates: {why}"
        )
    if partly := sorted({code for r in scores.results if r.assigned for code in r.not_loaded}):
        lines.append(
            f"undecided where not violated, for rules were not loaded: {', '.join(partly)}"
        )
    if scores.copies:
        lines.append(f"copies of episodes, which count once: {count(len(scores.copies), 'file')}")
    if scores.aborted:
        lines.append(ended_in_error(scores.aborted))
    return lines
