"""Audit results for people, programs and build servers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import safestage_eval.audit.checks  # noqa: F401 (declares the checks)
from safestage_eval._text.line_width import LINE_WIDTH, folded
from safestage_eval._text.plural import count
from safestage_eval._text.printable import printable
from safestage_eval.audit import CHECKS, Audit, Check, Finding
from safestage_eval.doubts.check_registry import SEVERITIES
from safestage_eval.palette import TERMINAL
from safestage_eval.version import __version__

from .document import render_json
from .for_build_servers import Case, Help, Mark, render_github, render_junit, render_sarif
from .render_text import Sheet

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
    helps = {code: Help(CHECKS[code].title, CHECKS[code].why) for code in audit.checks}
    return {
        "table": lambda: _text(audit, Sheet(width, color=color), everything=everything),
        "json": lambda: _json(audit),
        "junit": lambda: _junit(audit),
        "github": lambda: render_github(_marks(audit), audit.problems),
        "sarif": lambda: render_sarif(_marks(audit), helps, audit.problems),
    }[form]()


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


def _text(audit: Audit, sheet: Sheet, *, everything: bool) -> str:
    """Findings by check, the gravest and then the lowest code first."""

    def gravity(finding: Finding) -> tuple[int, str]:
        return SEVERITIES.index(finding.severity), finding.code

    ordered = sorted(audit.findings, key=gravity)
    for (rank, code), same in groupby(ordered, gravity):
        findings = [*same]
        episodes = {finding.place.episode for finding in findings} - {""}
        of = f"{len(episodes)} of {count(audit.episodes, 'episode')}"
        head = f"{code} {SEVERITIES[rank]}: {CHECKS[code].title}"
        rest = f"{head}  ({of if episodes else 'of the evaluation'})"
        sheet.put(rest, mark=(head, f"bold {STYLES[SEVERITIES[rank]]}"))
        shown = findings if everything else findings[:SHOWN]
        for finding in shown:
            place = finding.place
            time = "" if place.time is None else f"  at {place.time:.2f} s"
            if place.episode or place.field or time:
                where = "  ".join(filter(None, (place.episode, place.field)))
                sheet.put(f"  {where}{time}", "bold")
            parts = (("", finding.what), ("likely: ", finding.cause), ("fix: ", finding.fix))
            for label, words in parts:
                if words:
                    sheet.put(f"    {label}{' '.join(words.split())}", mark=(label, "bold"))
        if len(findings) > len(shown):
            sheet.put(f"  … {len(findings) - len(shown)} more: --verbose lists them")
        sheet.put()
    for problem in audit.problems:
        sheet.put(f"unreadable: {problem.message}", STYLES["error"])
    if audit.problems:
        sheet.put()
    if audit.aborted:
        sheet.put(
            f"left out, ended in an error: {count(len(audit.aborted), 'rollout')}; "
            "--where termination=error audits them"
        )
    sheet.put(headline(audit), "bold")
    if ordered:
        code = min(finding.code for finding in ordered)
        sheet.put(f"safestage audit --explain {code} says why a finding matters.")
    return str(sheet)


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


def _marks(audit: Audit) -> Iterator[Mark]:
    for f in audit.findings:
        place = f.place
        yield Mark(f.code, f.severity, _sentence(f), place.path, place.episode, {"fix": f.fix})


def _junit(audit: Audit) -> str:
    """One suite per check; a failure per error, and warnings and notes as skipped cases."""
    suites: dict[str, list[Case]] = {}
    for code in audit.checks:
        of = CHECKS[code].of
        suites[f"{code} {CHECKS[code].title}"] = [
            Case(
                code, f.place.episode or of,
                "failure" if f.severity == "error" else "skipped", _sentence(f),
            )
            for f in audit.findings
            if f.code == code
        ] or [Case(code, of)]  # fmt: skip
    if audit.problems:
        suites["unreadable"] = [
            Case("unreadable", problem.path, "error", problem.message) for problem in audit.problems
        ]
    return render_junit("safestage audit", suites)
