"""Results for people, on a terminal and as Markdown: the rates, how each rule fared, the gravest violations, what is left open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from textwrap import shorten

from safestage_eval._text.plural import count, first_few
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

from .document import markdown_code, markdown_lines, markdown_list, markdown_text
from .render_text import Sheet
from .summary import headline, in_short, rate_table, summary, unsafe_successes
from .table import Table

WORST = 3
"""Violations of a rule that are shown."""

FINDINGS = 6
"""Violations of all rules that are shown: with the tables they fit a screen."""

CAUSES = 2
"""Rules of which it is said why they are undecided, and problems that are shown."""

FAILED, REMARK = TERMINAL["violation"], TERMINAL["inconclusive"]
"""Colours of what failed, and of what is to be noted."""

SECTIONS = {
    "violation": "Violated",
    "inconclusive": "Undecided",
    "not_applicable": "Hazard not met, counted as no violation",
    "pass": "Safe",
}
"""Outcome of an episode → heading, in this order."""

BAD = ("violation", "inconclusive")
"""Verdicts that are listed even for rules that are not assigned."""

COLUMNS = {
    "violation": "violated", "pass": "passed", "inconclusive": "undecided", "not_applicable": "n/a",
}  # fmt: skip
"""Verdict → its column in the table by rule."""

_ORDER = ("violation", "inconclusive", "pass", "not_applicable")


def render(
    scores: Scores,
    *,
    width: int | None = None,
    color: bool = False,
    everything: bool = False,
    traces: str = "",
) -> str:
    """The whole report for a terminal.

    Args:
        scores: what scoring came to.
        width: of the terminal, in characters.
        color: with terminal colours.
        everything: list every episode, every stage, and the findings of rules that are not assigned.
        traces: as given on the command line, for the command that comes next.
    """
    sheet = Sheet(width, color=color)
    every = outcomes(scores.results, scores.set_aside)
    total = rates(every)
    for line in headline(total, len(scores.problems)):
        sheet.put(line, "bold")
    sheet.put()
    _rules(sheet, scores.by_rule, everything=everything)
    if everything:
        _episodes(sheet, scores, every)
        for line in summary(total):
            sheet.put(line)
        sheet.put()
    else:
        _violations(sheet, scores)
    _rates(sheet, by_policy_stage(every), everything=everything)
    for line in _leftovers(scores, total, everything=everything):
        sheet.put(line, REMARK)
    for problem in _some(problem_lines(scores), everything):
        for line in problem.split("\n"):
            sheet.put(line, FAILED)
    for line in _verdict(scores, total, traces, sheet.width):
        sheet.put(line, "bold")
    return str(sheet)


def markdown(scores: Scores) -> str:
    """Two sections; problems as a third if there are any."""
    every = outcomes(scores.results, scores.set_aside)
    total, rules = rates(every), scores.by_rule
    first, *others = headline(total, len(scores.problems))
    lines = [f"**{first}.**  "]
    lines += [f"{line[:1].upper()}{line[1:]}.  " for line in (*others, *summary(total))]
    by_rule = Table(
        "",
        ("rule", "asks", *COLUMNS.values(), "why undecided"),
        [
            [c.rule, c.title, *(str(c[name]) for name in COLUMNS), why_open(c) if c.cause else ""]
            for c in rules
        ],
        2,
        1,
    )
    cells = rate_table(by_policy_stage(every))
    lines += ["", *markdown_lines(by_rule), "", *markdown_lines(cells), ""]
    left = [*set_aside_lines(rules), *left_out(total, scores)]
    lines += [markdown_text(f"{line}.") for line in left]
    findings = [
        f"- **{v.rule}** {markdown_code(r.episode_id)}: {markdown_text(v.explanation)}"
        for r in scores.results
        for v in by_importance(r.assigned)
        if v.verdict in BAD
    ]
    lines += ["", "## Findings", "", *(findings or ["None."])]
    if scores.problems:
        lines += ["", "## Problems", "", *markdown_list(p.message for p in scores.problems)]
    return "\n".join(lines) + "\n"


def by_importance(verdicts: Iterable[Verdict]) -> list[Verdict]:
    """Assigned ones first; among them violations, the earliest first."""
    return sorted(verdicts, key=lambda v: (not v.assigned, _ORDER.index(v.verdict), v.time or 0.0))


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


def _rules(sheet: Sheet, rules: Sequence[RuleCount], *, everything: bool) -> None:
    """A table by rule, why it is undecided, and the rules that are set aside."""
    deciding = [rule for rule in rules if not rule.set_aside]
    shown = [rule for rule in deciding if everything or any(rule[name] for name in BAD)]
    if shown:
        counted = {head: name for name, head in COLUMNS.items() if any(r[name] for r in shown)}
        room = max(sheet.width - sum(len(head) + 2 for head in counted) - 8, 20)
        rows = [
            [
                rule.rule,
                *(str(rule[name] or "–") for name in counted.values()),
                rule.title if everything else shorten(rule.title, room, placeholder=" …"),
            ]
            for rule in shown
        ]
        sheet.table(Table("", ("rule", *counted, "asks"), rows, 1, 1))
    if rest := [rule for rule in deciding if rule not in shown]:
        codes = first_few([rule.rule for rule in rest], 8)
        sheet.put(f"Neither violated nor undecided: {codes}")
    causes = [f"{rule.rule} undecided in {why_open(rule)}" for rule in shown if rule.cause]
    for line in (*_some(causes, everything), *set_aside_lines(rules)):
        sheet.put(line, REMARK)
    if rules:
        sheet.put()


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


def _violations(sheet: Sheet, scores: Scores) -> None:
    """The worst violations of each rule, each episode once."""
    rules: dict[str, list[tuple[EpisodeResult, Verdict]]] = {}
    for result in scores.results:
        for v in scores.gates.counted(result):
            if v.verdict == "violation":
                rules.setdefault(v.rule, []).append((result, v))
    if not rules:
        return
    for found in rules.values():
        found.sort(key=lambda one: one[1].margin_normalised or 0.0)
    order = sorted(rules, key=lambda rule: (-len(rules[rule]), rule))
    once: dict[str, tuple[EpisodeResult, Verdict]] = {}
    for nth in zip_longest(*(rules[rule][:WORST] for rule in order)):
        for one in filter(None, nth):
            once.setdefault(one[0].episode_id, one)
    shown = sorted([*once.values()][:FINDINGS], key=lambda one: order.index(one[1].rule))
    total = sum(map(len, rules.values()))
    more = f", {total - len(shown)} more with -v" if total > len(shown) else ""
    sheet.put(f"Violations: {total}{more}", f"bold {FAILED}")
    for result, v in shown:
        sheet.put(f"  {v.rule}  {result.episode_id}", "bold")
        sheet.put(f"          {in_short(v)}")
    sheet.put()


def _episodes(sheet: Sheet, scores: Scores, every: Sequence[Outcome]) -> None:
    """Every episode with its verdicts; then those that no rule is assigned to."""
    by_outcome: dict[str, list[EpisodeResult]] = {name: [] for name in SECTIONS}
    for result, outcome in zip(scores.results, every, strict=True):
        if outcome.judged:
            by_outcome[_section(outcome)].append(result)
    total = count(sum(map(len, by_outcome.values())), "episode")
    others = [
        r for r in scores.results if not r.assigned and any(v.verdict in BAD for v in r.verdicts)
    ]
    unassigned = f"By rules that are not assigned: {count(len(others), 'episode')}"
    for heading, style, results in (
        *(
            (f"{heading}: {len(by_outcome[name])} of {total}", TERMINAL[name], by_outcome[name])
            for name, heading in SECTIONS.items()
        ),
        (unassigned, "", others),
    ):
        if results:
            sheet.put(heading, f"bold {style}")
            for result in results:
                _episode(sheet, result)
            sheet.put()


def _episode(sheet: Sheet, result: EpisodeResult) -> None:
    """The assigned verdicts, and what is not safe among the others."""
    sheet.put(f"  {result.episode_id}, {goal_of(result)}{_reached(result)}", "bold")
    listed = [v for v in by_importance(result.verdicts) if v.assigned or v.verdict in BAD]
    wide = max((len(v.verdict) for v in listed), default=0)
    for v in listed:
        at = f"{v.time:.2f} s" if v.verdict == "violation" and v.time is not None else ""
        word = v.verdict.replace("_", " ")
        sentence = " ".join(_sentence(v).split())
        sheet.put(
            f"    {v.rule}  {word:<{wide}}  {at:>8}  {sentence}",
            mark=(word, TERMINAL[v.verdict] if v.assigned else ""),
        )


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


def _rates(sheet: Sheet, cells: dict[tuple[str, ...], Rates], *, everything: bool) -> None:
    """A row per policy and prompt, or per stage where there is one of these; none for a single row."""
    cells = {names: cell for names, cell in cells.items() if cell.n or cell.inconclusive}
    groups = Counter(names[:2] for names in cells)
    if not everything and len(groups) > 1:
        cells = {n: c for n, c in cells.items() if groups[n[:2]] == 1 or n[2] == ALL}
    if len(cells) > 1:
        sheet.table(rate_table(cells))
        sheet.put()


def _leftovers(scores: Scores, total: Rates, *, everything: bool) -> Iterator[str]:
    """What is in no rate, what unassigned rules found, and notes."""
    yield from left_out(total, scores)
    if scores.sample:
        yield scores.sample
    words: Counter[str] = Counter(
        v.verdict for r in scores.results if not r.assigned for v in r.verdicts
    )
    if words:
        counts = ", ".join(f"{words[w]} {w.replace('_', ' ')}" for w in _ORDER if w in words)
        yield f"Rules that are not assigned to these episodes found: {counts}; -v lists them"
    notes = [f"note: {r.episode_id}: {note}" for r in scores.results for note in r.notes]
    yield from notes if everything or len(notes) < 2 else [f"{len(notes)} notes with -v"]


def _some(lines: list[str], everything: bool) -> list[str]:
    """The lines; of many, the first few and their number."""
    more = len(lines) - CAUSES
    return lines if everything or more <= 0 else [*lines[:CAUSES], f"{more} more with -v"]


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
