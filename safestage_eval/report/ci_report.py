"""Results for build servers: JUnit XML, and annotations for GitHub Actions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from safestage_eval._text.printable import printable_lines
from safestage_eval.run.scores import Scores

from .golden import Change

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold, not even escaped (XML 1.0, section 2.2)."""


def render_junit(scores: Scores, changes: Sequence[Change] | None = None) -> str:
    """One test suite per task, one test case per episode and rule that counts.

    Args:
        scores: the results.
        changes: what is not as a golden file expects. If given, these are the failures, and a
            violation that is expected is none.
    """
    root = ET.Element("testsuites", name="safestage")
    suites: dict[str, ET.Element] = {}
    left = list(changes or ())
    for result in scores.results:
        name = result.task or "–"
        if name not in suites:
            suites[name] = ET.SubElement(root, "testsuite", name=name)
        for v in scores.gates.counted(result):
            case = ET.SubElement(
                suites[name], "testcase", classname=f"{name}.{v.rule}", name=result.episode_id
            )
            own = [c for c in left if (c.episode_id, c.rule) == (result.episode_id, v.rule)]
            for change in own:
                ET.SubElement(case, "failure", message=change.what).text = v.explanation
                left.remove(change)
            if v.verdict == "violation" and changes is None:
                ET.SubElement(case, "failure", message=v.explanation).text = "\n".join(v.notes)
            elif (v.verdict == "inconclusive" or v.vacuity == "unbound") and not own:
                message = v.explanation or "; ".join(v.notes)
                ET.SubElement(case, "skipped", message=message)
        for rule in result.not_loaded:
            case = ET.SubElement(
                suites[name], "testcase", classname=f"{name}.{rule}", name=result.episode_id
            )
            ET.SubElement(case, "skipped", message=f"{rule} is assigned and was not loaded")
    if left:
        suite = ET.SubElement(root, "testsuite", name="golden")
        for change in left:
            name = ": ".join(filter(None, (change.episode_id, change.rule)))
            case = ET.SubElement(suite, "testcase", classname="golden", name=name)
            ET.SubElement(case, "failure", message=change.what)
    if scores.problems:
        suite = ET.SubElement(root, "testsuite", name="problems")
        for problem in scores.problems:
            case = ET.SubElement(suite, "testcase", classname="problems", name=problem.path)
            ET.SubElement(case, "error", message=problem.message)
    return junit_text(root)


def junit_text(root: ET.Element) -> str:
    """The document of some suites, each with its counts."""
    for suite in root:
        suite.set("tests", str(len(suite)))
        for kind in ("failure", "skipped", "error"):
            suite.set(
                f"{kind}s" if kind != "skipped" else kind, str(len(suite.findall(f".//{kind}")))
            )
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
    return printable_lines(_NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text))


def render_github(scores: Scores, changes: Sequence[Change] | None = None) -> str:
    """One workflow command per finding and problem; with ``changes``, per change and problem."""
    lines = [
        github_line("error", " ".join(filter(None, (c.rule, c.episode_id))), c.what)
        for c in changes or ()
    ]
    for result in scores.results if changes is None else ():
        for v in scores.gates.counted(result):
            if v.verdict in ("violation", "inconclusive"):
                level = "error" if v.verdict == "violation" else "warning"
                lines.append(github_line(level, f"{v.rule} {result.episode_id}", v.explanation))
        for rule in result.not_loaded:
            title = f"{rule} {result.episode_id}"
            lines.append(github_line("warning", title, "it is assigned and was not loaded"))
    lines += [github_line("error", "unreadable trace", p.message) for p in scores.problems]
    return "".join(line + "\n" for line in lines)


def github_line(level: str, title: str, message: str) -> str:
    """A workflow command of one of the levels error, warning and notice."""
    return f"::{level} title={_escaped(title, field=True)}::{_escaped(message)}"


def _escaped(text: str, *, field: bool = False) -> str:
    text = printable_lines(text)
    for raw, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(raw, code)
    return text.replace(":", "%3A").replace(",", "%2C") if field else text
