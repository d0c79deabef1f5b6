"""Findings as SARIF 2.1.0, which code scanning reads.

https://docs.oasis-open.org/sarif/sarif/v2.1.0/sarif-v2.1.0.html
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from safestage_eval._text.json_out import to_json
from safestage_eval._text.printable import printable
from safestage_eval.run.scores import Scores
from safestage_eval.version import __version__

SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
ROOT = "%SRCROOT%"
LINE = 1
"""Traces have no lines; code scanning shows a result only with one."""

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
    path: str
    episode: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Help:
    """Title of a rule, and why it matters."""

    title: str
    why: str = ""


def render_sarif(
    marks: Iterable[Mark], helps: Mapping[str, Help], problems: Iterable[tuple[str, str]] = ()
) -> str:
    """One run; ``problems``: path and message of each trace that could not be read."""
    listed = list(marks)
    codes = sorted({*helps, *(mark.rule for mark in listed)})
    notifications = [
        {"level": "error", "message": _text(message), "locations": [_place(path)]}
        for path, message in problems
    ]
    run = {
        "tool": {
            "driver": {
                "name": "SafeStage",
                "version": __version__,
                "rules": [_rule(code, helps.get(code, Help(code))) for code in codes],
            }
        },
        "invocations": [
            {
                "executionSuccessful": not notifications,
                "toolExecutionNotifications": notifications,
            }
        ],
        "results": [_result(mark, codes.index(mark.rule)) for mark in listed],
        "columnKind": "unicodeCodePoints",
    }
    return to_json({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, 1) + "\n"


def _rule(code: str, about: Help) -> dict[str, Any]:
    text = about.why or about.title
    return {
        "id": code,
        "name": printable(about.title) or code,
        "shortDescription": _text(about.title or code),
        "fullDescription": _text(text or code),
        "help": _text(text or code),
    }


def _result(mark: Mark, index: int) -> dict[str, Any]:
    fingerprint = sha256(f"{mark.rule}\0{mark.episode}\0{Path(mark.path).name}".encode("utf-8", "replace"))  # fmt: skip
    place = _place(mark.path)
    if mark.episode:
        place["logicalLocations"] = [{"name": printable(mark.episode), "kind": "episode"}]
    return {
        "ruleId": mark.rule,
        "ruleIndex": index,
        "level": mark.level,
        "message": _text(f"{mark.episode}: {mark.message}" if mark.episode else mark.message),
        "locations": [place],
        "partialFingerprints": {"safestageFinding/v1": fingerprint.hexdigest()},
        "properties": {name: value for name, value in mark.facts.items() if value is not None},
    }


def _text(text: str) -> dict[str, str]:
    return {"text": printable(text) or "–"}


def _place(path: str) -> dict[str, Any]:
    """A file, by its path below the folder of the command where it is there."""
    whole = Path(path)
    if whole.is_absolute() and whole.is_relative_to(Path.cwd()):
        whole = whole.relative_to(Path.cwd())
    data = whole.as_posix().encode("utf-8", "surrogateescape")
    location = {"uri": f"file://{quote(data)}"} if whole.is_absolute() else {"uri": quote(data), "uriBaseId": ROOT}  # fmt: skip
    return {"physicalLocation": {"artifactLocation": location, "region": {"startLine": LINE}}}


MILD = ("minor", "mild", "light", "low", "slight")
"""Levels of severity, as rule files name them, that are warnings; a violation of any other is an error."""


def results(scores: Scores) -> str:
    """The document."""
    helps = {
        code: Help(title, scores.reasons.get(code, "")) for code, title in scores.rules.items()
    }
    return render_sarif(_marks(scores), helps, [(p.path, p.message) for p in scores.problems])


def _marks(scores: Scores) -> Iterator[Mark]:
    for result in scores.results:
        for v in scores.gates.counted(result):
            if v.verdict not in ("violation", "inconclusive"):
                continue
            mild = v.verdict == "inconclusive" or v.severity in MILD
            level: Level = "warning" if mild else "error"
            facts = {
                "verdict": v.verdict, "severity": v.severity, "time": v.time, "value": v.value,
                "ruleDigest": v.rule_digest, "traceHash": result.trace_hash,
            }  # fmt: skip
            finite = {
                name: fact
                for name, fact in facts.items()
                if not isinstance(fact, float) or math.isfinite(fact)
            }
            message = v.explanation or "; ".join(v.notes) or v.title
            yield Mark(v.rule, level, message, result.path, result.episode_id, finite)
        for rule in result.not_loaded:
            message = "it is assigned and was not loaded"
            yield Mark(rule, "warning", message, result.path, result.episode_id)
