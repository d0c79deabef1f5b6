"""Audit results for people, programs and build servers."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from itertools import groupby

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

import safestage_eval.audit.checks  # noqa: F401 (declares the checks)
from safestage_eval._text.line_width import LINE_WIDTH, folded
from safestage_eval._text.plural import count
from safestage_eval._text.printable import printable
from safestage_eval.audit import CHECKS, Audit, Check, Finding
from safestage_eval.doubts.check_registry import SEVERITIES
from safestage_eval.palette import TERMINAL
from safestage_eval.version import __version__

from .render_github import github_line
from .render_json import render_json
from .render_junit import Case, render_junit
from .render_sarif import Help, Mark, render_sarif
from .results_text import console_for, put

FORMATS = ("table", "json", "junit", "github", "sarif")

SHOWN = 3
"""Findings of a code that are written out; of more only the episodes are counted."""

STYLES = {
    "error": TERMINAL["violation"], "warning": TERMINAL["inconclusive"], "note": TERMINAL["pass"],
}  # fmt: skip


def render(
    audit: Audit,
    form: str = "table",
    *,
    width: int | None = None,
    color: bool = False,
    everything: bool = False,
) -> str:
    """An audit in one of ``FORMATS``. Raises KeyError for another.

    Args:
        audit: what it came to.
        form: the format.
        width: of the terminal, in characters; for the table, as the next two.
        color: with terminal colours.
        everything: write every finding out.
    """
    if form == "table":
        return _text(audit, width, color=color, everything=everything)
    formats: dict[str, Callable[[Audit], str]] = {
        "json": _json, "junit": _junit, "github": _github, "sarif": _sarif,
    }  # fmt: skip
    return formats[form](audit)


def explain(check: Check) -> str:
    """One check in words: what it finds, why that matters, an example."""
    lines = [
        f"{check.code}  {check.title} ({check.severity}, of the {check.of})",
        "",
        f"How:      {check.how}",
        f"Why:      {check.why}",
        f"Example:  {check.example}",
    ]
    lines += [f"Seen in:  {check.issue}"] if check.issue else []
    return folded("\n".join(lines), LINE_WIDTH.get()) + "\n"


def headline(audit: Audit) -> str:
    """Count the findings: ``12 episodes: 3 errors, 1 warning, in 2 of them``."""
    total = count(audit.episodes, "episode")
    if audit.problems:
        total = f"{audit.episodes - len(audit.problems)} of {total} could be read"
    parts = [count(n, name) for name, n in audit.counts.items() if n]
    if not parts:
        if len(audit.problems) == audit.episodes:
            return f"{total}."
        return f"{total}: nothing found by {count(len(audit.checks), 'check')}."
    bad = {f.place.episode for f in audit.findings if f.place.episode}
    bad |= {episode for f in audit.findings for episode in f.episodes}
    return f"{total}: {', '.join(parts)}, in {len(bad)} of them."


def _by_code(audit: Audit) -> list[tuple[Check, str, list[Finding]]]:
    """Check, severity and findings, the gravest and then the lowest code first."""

    def key(finding: Finding) -> tuple[int, str]:
        return SEVERITIES.index(finding.severity), finding.code

    groups = groupby(sorted(audit.findings, key=key), key)
    return [(CHECKS[code], SEVERITIES[rank], [*some]) for (rank, code), some in groups]


def _text(audit: Audit, width: int | None, *, color: bool, everything: bool) -> str:
    buffer = io.StringIO()
    console = console_for(buffer, width, color=color)
    for check, severity, findings in _by_code(audit):
        head = Text(f"{check.code} {severity}: {check.title}", f"bold {STYLES[severity]}")
        console.print(head.append(f"  ({_count(findings, audit.episodes)})", "not bold default"))
        shown = findings if everything else findings[:SHOWN]
        for finding in shown:
            _one(console, finding)
        if len(findings) > len(shown):
            console.print(f"  … {len(findings) - len(shown)} more: --verbose lists them")
        console.print()
    for problem in audit.problems:
        console.print(Text(printable(f"unreadable: {problem.message}"), STYLES["error"]))
    if audit.problems:
        console.print()
    if audit.aborted:
        console.print(
            f"left out, ended in an error: {count(len(audit.aborted), 'rollout')}; "
            "--where termination=error audits them"
        )
    console.print(Text(headline(audit), "bold"))
    codes = sorted({finding.code for finding in audit.findings})
    if codes:
        console.print(f"safestage audit --explain {codes[0]} says why a finding matters.")
    return "".join(line.rstrip() + "\n" for line in buffer.getvalue().splitlines())


def _one(console: Console, finding: Finding) -> None:
    where = "  ".join(filter(None, (finding.place.episode, finding.place.field)))
    time = "" if finding.place.time is None else f"  at {finding.place.time:.2f} s"
    if where or time:
        put(console, printable(f"  {where}{time}"), "bold")
    parts = [("", finding.what), ("likely: ", finding.cause), ("fix: ", finding.fix)]
    for label, words in parts:
        if words:
            text = Text(label, "bold").append(printable(" ".join(words.split())), "not bold")
            console.print(Padding(text, (0, 0, 0, 4)))


def _count(findings: Iterable[Finding], total: int) -> str:
    episodes = {finding.place.episode for finding in findings} - {""}
    return f"{len(episodes)} of {count(total, 'episode')}" if episodes else "of the evaluation"


def _json(audit: Audit) -> str:
    return render_json(
        {
            "version": __version__,
            "episodes": audit.episodes,
            "counts": audit.counts,
            "findings": [finding.to_json() for finding in audit.findings],
            "problems": [{"path": p.path, "message": p.message} for p in audit.problems],
            "aborted": audit.aborted,
            "checks": audit.checks,
        }
    )


def _sentence(finding: Finding) -> str:
    parts = [finding.what, finding.cause and f"Likely: {finding.cause}", f"Fix: {finding.fix}"]
    ended = (part if part.endswith((".", "?")) else f"{part}." for part in parts if part)
    return printable(" ".join(ended))


def _junit(audit: Audit) -> str:
    """One suite per check; a failure per error, and warnings and notes as skipped cases."""
    suites = {}
    for code in audit.checks:
        check = CHECKS[code]
        suites[f"{code} {check.title}"] = [
            Case(
                code,
                finding.place.episode or check.of,
                "failure" if finding.severity == "error" else "skipped",
                _sentence(finding),
            )
            for finding in audit.findings
            if finding.code == code
        ] or [Case(code, check.of)]
    if audit.problems:
        suites["unreadable"] = [
            Case("unreadable", problem.path, "error", problem.message) for problem in audit.problems
        ]
    return render_junit("safestage audit", suites)


def _sarif(audit: Audit) -> str:
    marks = (
        Mark(f.code, f.severity, _sentence(f), f.place.path, f.place.episode, {"fix": f.fix})
        for f in audit.findings
    )
    helps = {code: Help(CHECKS[code].title, CHECKS[code].why) for code in audit.checks}
    return render_sarif(marks, helps, [(p.path, p.message) for p in audit.problems])


def _github(audit: Audit) -> str:
    level = {"error": "error", "warning": "warning", "note": "notice"}
    lines = [
        github_line(
            level[f.severity], f"{f.code} {printable(f.place.episode)}".strip(), _sentence(f)
        )
        for f in audit.findings
    ]
    lines += [
        github_line("error", "unreadable trace", printable(p.message)) for p in audit.problems
    ]
    return "".join(lines)
