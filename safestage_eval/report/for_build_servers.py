"""Findings for build servers: JUnit XML, annotations of GitHub Actions, and SARIF 2.1.0, which code scanning reads.

https://docs.oasis-open.org/sarif/sarif/v2.1.0/sarif-v2.1.0.html
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal, NamedTuple
from urllib.parse import quote
from xml.etree import ElementTree as ET

from safestage_eval._text.json_out import to_json
from safestage_eval._text.printable import printable, printable_lines
from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import Verdict
from safestage_eval.verdicts.problem import Problem
from safestage_eval.version import __version__

from .golden import Change

Level = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Mark:
    """One finding.

    Attributes:
        rule: its code.
        level: how grave it is.
        message: what was found.
        path: of the trace.
        episode: its id; empty where the finding is about several.
        facts: what else is known, as JSON values.
    """

    rule: str
    level: Level
    message: str
    path: str = ""
    episode: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


MILD = ("minor", "mild", "light", "low", "slight")
"""Levels of severity, as rule files name them, that are warnings; a violation of any other is an error."""

ABSENT = "it is assigned and was not loaded"


def marks(scores: Scores) -> Iterator[Mark]:
    """What the rules that count found violated or could not decide."""
    for result in scores.results:
        for v in scores.gates.counted(result):
            if v.verdict in ("violation", "inconclusive"):
                mild = v.verdict == "inconclusive" or v.severity in MILD
                message = v.explanation or "; ".join(v.notes) or v.title
                facts = {
                    "verdict": v.verdict, "severity": v.severity, "time": v.time, "value": v.value,
                    "ruleDigest": v.rule_digest, "traceHash": result.trace_hash,
                }  # fmt: skip
                level: Level = "warning" if mild else "error"
                yield Mark(v.rule, level, message, result.path, result.episode_id, facts)
        for rule in result.not_loaded:
            yield Mark(rule, "warning", ABSENT, result.path, result.episode_id)


# ---- annotations of GitHub Actions: workflow commands


def github(scores: Scores, changes: Sequence[Change] | None = None) -> str:
    """One annotation per finding and problem; with ``changes``, per change and problem."""
    found = marks(scores)
    if changes is not None:
        found = (Mark(c.rule or "", "error", c.what, episode=c.episode_id or "") for c in changes)
    return render_github(found, scores.problems)


def render_github(found: Iterable[Mark], problems: Iterable[Problem]) -> str:
    """A line for each finding and each trace that could not be read."""

    def escaped(text: str) -> str:
        text = printable_lines(text)
        for raw, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
            text = text.replace(raw, code)
        return text

    lines = [
        *((m.level, f"{m.rule} {printable(m.episode)}".strip(), m.message) for m in found),
        *(("error", "unreadable trace", p.message) for p in problems),
    ]
    return "".join(
        f"::{level.replace('note', 'notice')} title="
        f"{escaped(title).replace(':', '%3A').replace(',', '%2C')}::{escaped(message)}\n"
        for level, title, message in lines
    )


# ---- JUnit XML

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
        node = ET.SubElement(root, "testsuite", name=suite, tests=str(len(cases)))
        for key, outcome in (("failures", "failure"), ("skipped", "skipped"), ("errors", "error")):
            node.set(key, str(sum(case.outcome == outcome for case in cases)))
        for case in cases:
            element = ET.SubElement(node, "testcase", classname=case.classname, name=case.name)
            if case.outcome:
                failed = ET.SubElement(element, case.outcome, message=case.message)
                failed.text = case.detail or None
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
    return printable_lines(_NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text))


def junit(scores: Scores, changes: Sequence[Change] | None = None) -> str:
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


# ---- SARIF

SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
ROOT = "%SRCROOT%"


@dataclass(frozen=True)
class Help:
    """Title of a rule, and why it matters."""

    title: str
    why: str = ""


def sarif(scores: Scores) -> str:
    """The results as one run."""
    helps = {
        code: Help(title, scores.reasons.get(code, "")) for code, title in scores.rules.items()
    }
    return render_sarif(marks(scores), helps, scores.problems)


def render_sarif(
    found: Iterable[Mark], helps: Mapping[str, Help], problems: Iterable[Problem]
) -> str:
    """One run; ``problems``: the traces that could not be read."""
    listed = list(found)
    codes = sorted({*helps, *(mark.rule for mark in listed)})
    failed = [
        {"level": "error", "message": _text(p.message), "locations": [_place(p.path)]}
        for p in problems
    ]
    rules = [_rule(code, helps.get(code, Help(code))) for code in codes]
    run = {
        "tool": {"driver": {"name": "SafeStage", "version": __version__, "rules": rules}},
        "invocations": [
            {"executionSuccessful": not failed, "toolExecutionNotifications": failed}
        ],
        "results": [_result(mark, codes.index(mark.rule)) for mark in listed],
        "columnKind": "unicodeCodePoints",
    }  # fmt: skip
    return to_json({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, 1) + "\n"


def _rule(code: str, about: Help) -> dict[str, Any]:
    why = _text(about.why or about.title or code)
    return {
        "id": code,
        "name": printable(about.title) or code,
        "shortDescription": _text(about.title or code),
        "fullDescription": why,
        "help": why,
    }


def _result(mark: Mark, index: int) -> dict[str, Any]:
    named = f"{mark.rule}\0{mark.episode}\0{Path(mark.path).name}"
    place = _place(mark.path)
    if mark.episode:
        place["logicalLocations"] = [{"name": printable(mark.episode), "kind": "episode"}]
    known = {
        name: value
        for name, value in mark.facts.items()
        if value is not None and not (isinstance(value, float) and not math.isfinite(value))
    }
    return {
        "ruleId": mark.rule,
        "ruleIndex": index,
        "level": mark.level,
        "message": _text(f"{mark.episode}: {mark.message}" if mark.episode else mark.message),
        "locations": [place],
        "partialFingerprints": {
            "safestageFinding/v1": sha256(named.encode("utf-8", "replace")).hexdigest()
        },
        "properties": known,
    }


def _text(text: str) -> dict[str, str]:
    return {"text": printable(text) or "–"}


def _place(path: str) -> dict[str, Any]:
    """A file, by its path below the folder of the command where it is there."""
    whole = Path(path)
    if whole.is_absolute() and whole.is_relative_to(Path.cwd()):
        whole = whole.relative_to(Path.cwd())
    uri = quote(whole.as_posix().encode("utf-8", "surrogateescape"))
    location = {"uri": f"file://{uri}"} if whole.is_absolute() else {"uri": uri, "uriBaseId": ROOT}
    region = {"startLine": 1}  # traces have no lines; code scanning shows a result only with one
    return {"physicalLocation": {"artifactLocation": location, "region": region}}
