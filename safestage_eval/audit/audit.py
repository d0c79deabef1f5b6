"""Audit recordings: each by itself, and all of them as one evaluation."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from safestage_eval._process.children import WORTH_A_POOL
from safestage_eval.doubts.check_registry import SEVERITIES, Check, Severity
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.discover import find
from safestage_eval.formats.episode_filter import Selection
from safestage_eval.run.settings import Settings, load_settings
from safestage_eval.verdicts.problem import Problem

from .audit_episode import Audited, audit_episode, finding_of
from .campaign_summary import Campaign
from .choose import choose
from .finding import Finding

Tell = Callable[[int, int | None], None]


@dataclass(frozen=True)
class Audit:
    """Result of an audit.

    Attributes:
        findings: of each episode, in the order in which they were found, then of the evaluation.
        episodes: how many were audited.
        problems: those that could not be read.
        aborted: ids of rollouts that ended in an error: not audited.
        checks: codes of the checks that were carried out.
    """

    findings: tuple[Finding, ...]
    episodes: int
    problems: tuple[Problem, ...] = ()
    aborted: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()

    @property
    def counts(self) -> dict[Severity, int]:
        """How many findings there are of each severity."""
        severities = Counter(finding.severity for finding in self.findings)
        return {severity: severities[severity] for severity in SEVERITIES}

    @property
    def plain(self) -> dict[str, Any]:
        """Counts and findings as JSON values."""
        return {"counts": self.counts, "findings": [finding.to_json() for finding in self.findings]}

    def fails(self, level: str) -> bool:
        """Whether anything is as grave as ``error`` or ``warning``; never for ``never``."""
        if level == "never":
            return False
        grave = SEVERITIES[: SEVERITIES.index(cast(Severity, level)) + 1]
        return any(finding.severity in grave for finding in self.findings)


def audit(
    paths: str | Path | Iterable[str | Path],
    rules: Sequence[str | Path] = (),
    *,
    bind: str | Path | None = None,
    assign: Sequence[str] = (),
    roles: Sequence[str] = (),
    protect: Sequence[str] = (),
    where: Mapping[str, str] | None = None,
    select: Iterable[str] = (),
    ignore: Iterable[str] = (),
    jobs: int | None = None,
    progress: Tell | None = None,
) -> Audit:
    """Say what is wrong with recordings, with the scenes in them, and with the evaluation they make.

    Args:
        paths: files and folders.
        rules: paths, folders or built-in names of rule files; all built-in ones if empty.
        bind: a bind file, for roles and rules that headers lack.
        assign: codes of rules for every episode; this and the next two as on the command line.
        roles: ``ROLE=BODIES``.
        protect: bodies of the role ``protected``.
        where: header field → value; only episodes that match are audited.
        select: codes of the checks to be carried out, or how they begin; all if empty.
        ignore: without these.
        jobs: worker processes; as many as there are processors if None, none for a few episodes.
        progress: called with (done, total) after each episode.

    Raises:
        TraceError: nothing was found.
        InputError: a code that no check has; nothing matches ``where``.
        RuleErrors, RuleError: rules or a bind file that do not mean anything.
    """
    from safestage_eval.rules import builtin_names

    checks = choose(select, ignore)
    specs = list(rules) or builtin_names()
    settings = load_settings(specs, bind=bind, assign=assign, roles=roles, protect=protect)
    chosen = Selection(find([paths] if isinstance(paths, str | Path) else list(paths)), where)
    refs = [*chosen]
    episodes = audit_many(refs, checks, settings, jobs=jobs, progress=progress)
    audited = [one for one in episodes if isinstance(one, Audited)]
    problems = tuple(one for one in episodes if isinstance(one, Problem))
    aborted = tuple(chosen.aborted)
    campaign = Campaign([one.summary for one in audited], len(problems), aborted)
    findings = [finding for one in audited for finding in one.findings]
    findings += audit_campaign(campaign, checks, findings)
    return Audit(tuple(findings), len(episodes), problems, aborted, tuple(c.code for c in checks))


def audit_campaign(
    campaign: Campaign, checks: Iterable[Check], known: Iterable[Finding] = ()
) -> list[Finding]:
    """Run the checks of an evaluation.

    ``known``: findings of the episodes; one of ``Check.unless`` explains what is about its episode alone.
    """
    explained = {(finding.place.episode, finding.code) for finding in known}
    path = {summary.episode_id: summary.path for summary in campaign.episodes}
    findings = []
    for check in checks:
        for defect in check.run(campaign) if check.over == "campaign" else ():
            one = defect.episodes[0] if len(defect.episodes) == 1 else ""
            if any((one, code) in explained for code in check.unless):
                continue
            where = path.get(one, "")
            findings.append(finding_of(check, defect, path=where))
    return findings


def audit_many(
    refs: Sequence[EpisodeRef],
    checks: Sequence[Check],
    settings: Settings,
    *,
    jobs: int | None = None,
    progress: Tell | None = None,
) -> list[Audited | Problem]:
    """Audit episodes, each by itself; what comes back is in the order of what went in."""
    workers = min(jobs or os.cpu_count() or 1, len(refs))
    episodes: dict[int, Audited | Problem] = {}

    def note(number: int, one: object) -> None:
        episodes[number] = cast("Audited | Problem", one)
        if progress is not None:
            progress(len(episodes), len(refs))

    if workers > 1 and (jobs is not None or len(refs) >= WORTH_A_POOL):
        from safestage_eval.run.pool import Local

        from .audit_episode import opened

        codes = tuple(check.code for check in checks)
        with Local(workers, settings, codes, opened=opened) as engine:
            for number, one in engine.run(enumerate(refs)):
                note(number, one)
    else:
        for number, ref in enumerate(refs):
            note(number, audit_episode(ref, checks, settings.rule_set, settings.bind))
    return [episodes[number] for number in range(len(refs))]
