"""The cheap part of the audit, on what scoring has read anyway."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property, lru_cache
from typing import Any

from safestage_eval._text.plural import count
from safestage_eval.doubts.check_registry import Check
from safestage_eval.episode import Episode
from safestage_eval.errors import TraceError
from safestage_eval.rules import BindFile, RuleSet
from safestage_eval.run.scores import Scores

from .audit import Audit, audit_campaign
from .audit_episode import check_subject
from .campaign_summary import Campaign, Summary, summarize
from .choose import choose
from .diagnosis import Diagnosis
from .finding import Finding, Place
from .subject import Subject

TOLD = ("AUD155", "AUD156")
"""Cheap checks that are left out: scoring itself reports what was not loaded."""


class _Judged(Subject):
    """An episode that was judged: what was read of it does not contradict itself."""

    readable, whole = True, False

    @cached_property
    def broken(self) -> list[TraceError]:
        """Nothing: else it would be a problem."""
        return []

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """Nothing to be explained."""
        return Diagnosis()


@lru_cache(maxsize=1)
def _cheap() -> tuple[Check, ...]:
    return tuple(check for check in choose(ignore=TOLD) if check.cheap)


def look(episode: Episode, rules: RuleSet, bind: BindFile | None) -> dict[str, Any]:
    """Facts and findings of the cheap checks in an episode that was just judged, as JSON values.

    Returns:
        ``findings``, and the ``summary`` for the checks of an evaluation.
    """
    subject = _Judged(episode, rules, bind)
    findings = check_subject(subject, _cheap(), str(episode.path or ""))
    summary = dict(vars(summarize(subject, goal=False)))
    del summary["waypoints"], summary["goal"]
    return {"findings": [finding.to_json() for finding in findings], "summary": summary}


def audit_scores(scores: Scores) -> Audit | None:
    """Findings in the episodes of a run, and in the evaluation as a whole.

    None where no episode was looked at.
    """
    findings: list[Finding] = []
    summaries: list[Summary] = []
    for result in scores.results:
        if result.audit is not None:
            findings += map(_finding, result.audit["findings"])
            stored = {**result.audit["summary"], "content_hash": result.trace_hash}
            stored["start"] = tuple((name, tuple(pose)) for name, pose in stored["start"])
            summaries.append(Summary(**{**stored, "targets": tuple(stored["targets"])}))
    if not summaries:
        return None
    campaign = Campaign(summaries, len(scores.problems), scores.aborted)
    findings += audit_campaign(campaign, _cheap(), findings)
    codes = tuple(check.code for check in _cheap())
    return Audit(tuple(findings), len(summaries), scores.problems, scores.aborted, codes)


def _finding(stored: dict[str, Any]) -> Finding:
    given = {**stored, "episodes": tuple(stored["episodes"]), "bodies": tuple(stored["bodies"])}
    place = Place(*(given.pop(name) for name in ("episode", "path", "bodies", "field", "time")))
    return Finding(place=place, **given)


def in_one_line(audit: Audit, command: str) -> str:
    """How much was found and the command that shows it; empty where there are but notes."""
    graver = [f for f in audit.findings if f.severity != "note"]
    if not graver:
        return ""
    counts = ", ".join(_counts(audit))
    bad = {f.place.episode for f in graver if f.place.episode}
    bad |= {episode for f in graver for episode in f.episodes}
    where = f" in {len(bad)} of {count(audit.episodes, 'episode')}" if bad else ""
    return f"audit: {counts}{where}; {command} shows them"


def _counts(audit: Audit) -> Iterator[str]:
    for severity, number in audit.counts.items():
        if number and severity != "note":
            yield count(number, severity)
