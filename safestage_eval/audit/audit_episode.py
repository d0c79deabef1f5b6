"""The checks of one episode: the pure function that every process of an audit calls."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from safestage_eval._process.within import within_limits
from safestage_eval.doubts.check_registry import Check
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import BindFile, RuleSet
from safestage_eval.run.settings import Settings
from safestage_eval.verdicts.problem import Problem

from .campaign_summary import Summary, summarize
from .choose import choose
from .finding import Defect, Finding, Place
from .start import start_of
from .subject import Subject


@dataclass(frozen=True)
class Audited:
    """Findings of one episode; can be pickled.

    Attributes:
        summary: for the checks of an evaluation.
        findings: by code.
    """

    summary: Summary
    findings: tuple[Finding, ...]


def audit_episode(
    ref: EpisodeRef, checks: Sequence[Check], rules: RuleSet, bind: BindFile | None = None
) -> Audited | Problem:
    """Open one episode and carry out the checks that are about one; what cannot be read is a problem."""
    try:
        with within_limits(ref.shown):
            subject = Subject(ref.open(checked=False), rules, bind)
            findings = tuple(check_subject(subject, checks, ref.shown))
            audited = Audited(summarize(subject, ref.content_hash), findings)
            subject.close()
            return audited
    except InputError as error:
        return Problem(ref.shown, str(error))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        return Problem(ref.shown, f"{ref.shown}: cannot be read: {type(error).__name__}: {error}")


def opened(settings: Settings, codes: tuple[str, ...]) -> Callable[[EpisodeRef], Any]:
    """Return the function that audits one episode in a worker process, by these checks."""
    from safestage_eval.run.worker import lasting

    checks, rules = choose(codes), settings.rule_set
    return lasting(lambda ref: audit_episode(ref, checks, rules, settings.bind))


def check_subject(subject: Subject, checks: Iterable[Check], path: str = "") -> list[Finding]:
    """Run the checks of an episode; findings in the order of the checks.

    A defect that an earlier check of ``Check.unless`` explains is left out.
    """
    explained: dict[str, list[tuple[str, ...]]] = {}
    findings = []
    for check in checks:
        for defect in _defects(check, subject):
            if any(
                not bodies or not defect.bodies or set(bodies) & set(defect.bodies)
                for code in check.unless
                for bodies in explained.get(code, ())
            ):
                continue
            explained.setdefault(check.code, []).append(defect.bodies)
            findings.append(finding_of(check, defect, subject.header.episode_id, path))
    return findings


def _defects(check: Check, subject: Subject) -> Iterator[Defect]:
    """What a check finds in one episode; of columns what its diagnosis says."""
    if check.over != "campaign":
        if check.over == "scene":
            start = start_of(subject)
            yield from check.run(start) if start is not None else ()
        elif check.over == "episode":
            yield from check.run(subject)
        else:
            yield from subject.explained(check.code)
        for run in check.more:
            yield from run(subject)


def finding_of(check: Check, defect: Defect, episode: str = "", path: str = "") -> Finding:
    """A defect with its code and its episode."""
    one = defect.episodes[0] if len(defect.episodes) == 1 else ""
    place = Place(episode or one, path, defect.bodies, defect.field, defect.time)
    severity = defect.severity or check.severity
    return Finding(
        check.code, severity, place, defect.what, defect.cause, defect.fix, defect.episodes
    )
