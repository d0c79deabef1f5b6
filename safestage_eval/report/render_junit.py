"""Test cases as JUnit XML, for build servers; results too."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree as ET

from safestage_eval._text.printable import printable_lines
from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import Verdict

from .golden import Change

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold, not even escaped (XML 1.0, section 2.2)."""


class Case(NamedTuple):
    """One test case.

    Attributes:
        classname, name: of the case.
        outcome: how it failed; empty if it passed.
        message: why.
        detail: more on a failure, in lines.
    """

    classname: str
    name: str
    outcome: Literal["", "failure", "skipped", "error"] = ""
    message: str = ""
    detail: str = ""


def render_junit(name: str, suites: Mapping[str, Sequence[Case]]) -> str:
    """The document: suites with their cases and counts."""
    root = ET.Element("testsuites", name=name)
    for suite, cases in suites.items():
        node = ET.SubElement(root, "testsuite", name=suite)
        for case in cases:
            element = ET.SubElement(node, "testcase", classname=case.classname, name=case.name)
            if case.outcome:
                ET.SubElement(element, case.outcome, message=case.message).text = (
                    case.detail or None
                )
        outcomes = [case.outcome for case in cases]
        node.set("tests", str(len(cases)))
        for key, outcome in (("failures", "failure"), ("skipped", "skipped"), ("errors", "error")):
            node.set(key, str(sum(one == outcome for one in outcomes)))
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
    return printable_lines(_NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text))


def results(scores: Scores, changes: Sequence[Change] | None = None) -> str:
    """One test suite per task, one test case per episode and rule that counts.

    Args:
        scores: the results.
        changes: what is not as a golden file expects. If given, these are the failures, and a
            violation that is expected is none.
    """
    suites: dict[str, list[Case]] = {}
    left = list(changes or ())
    for result in scores.results:
        task, episode = result.task or "–", result.episode_id
        suite = suites.setdefault(task, [])
        for v in scores.gates.counted(result):
            own = [c for c in left if (c.episode_id, c.rule) == (episode, v.rule)]
            left = [change for change in left if change not in own]
            failure = _failure(v, own, violations=changes is None)
            suite.append(Case(f"{task}.{v.rule}", episode, *failure))
        suite += [
            Case(f"{task}.{rule}", episode, "skipped", f"{rule} is assigned and was not loaded")
            for rule in result.not_loaded
        ]
    for change in left:
        name = ": ".join(filter(None, (change.episode_id, change.rule)))
        suites.setdefault("golden", []).append(Case("golden", name, "failure", change.what))
    for problem in scores.problems:
        case = Case("problems", problem.path, "error", problem.message)
        suites.setdefault("problems", []).append(case)
    return render_junit("safestage", suites)


def _failure(v: Verdict, own: Sequence[Change], *, violations: bool) -> tuple[Any, ...]:
    """Outcome, message and detail of a verdict; nothing of one that passes."""
    if own:
        return "failure", "; ".join(change.what for change in own), v.explanation
    if v.verdict == "violation" and violations:
        return "failure", v.explanation, "\n".join(v.notes)
    if v.verdict == "inconclusive" or v.vacuity == "unbound":
        return "skipped", v.explanation or "; ".join(v.notes)
    return ()
