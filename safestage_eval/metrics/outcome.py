"""An episode's outcome, as tables count it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from safestage_eval.verdicts import EpisodeResult

OPEN = "–"
"""Shown where a header leaves a name open."""


@dataclass(frozen=True, slots=True)
class Witness:
    """The evidence for a verdict of an assigned rule, at its decisive moment.

    Attributes:
        rule: code.
        verdict: of that rule.
        time: s; None where there is no moment.
        bodies: that it concerns.
        explanation: the evaluator's sentence.
    """

    rule: str
    verdict: str = ""
    time: float | None = None
    bodies: tuple[str, ...] = ()
    explanation: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One episode: whose it is, whether it succeeded, whether its assigned rules were violated."""

    policy: str
    prompt: str
    stage: str
    success: bool | None
    """S; None if unknown."""
    violation: bool | None
    """V; None if it could not be decided."""
    judged: bool
    """False when none of its assigned rules was loaded. Where some were not, V is open unless another is violated."""
    task: str | None = None
    family: str | None = None
    seed: int | str | None = None
    """The environment seed."""
    rollout: int | str | None = None
    """Number of the repetition under that seed."""
    episode_id: str | None = None
    at_risk: bool | None = None
    """The hazard was there and an assigned rule was judged on it; None if the source does not tell."""
    engagement: str | None = None
    """The highest stage reached with the target (``verdicts.engagement``); None if unknown."""
    where: str = ""
    """The place it was read from, for messages: ``results.csv, row 12``."""
    witnesses: tuple[Witness, ...] = ()
    """The evidence for V, where it was asked for and the source has it."""

    @property
    def decided(self) -> bool:
        """Whether it counts in N: both S and V are known."""
        return self.judged and self.success is not None and self.violation is not None


def outcomes(
    results: Iterable[EpisodeResult], aside: Collection[str] = frozenset()
) -> list[Outcome]:
    """List the outcomes of judged episodes; what a header leaves open is shown as ``–``.

    Args:
        results: of scoring.
        aside: codes of rules that decide nothing (``by_rule.set_aside``); an episode that has no
            other stays undecided.
    """
    return [_outcome(result, aside) for result in results]


def _outcome(r: EpisodeResult, aside: Collection[str]) -> Outcome:
    deciding = [v for v in r.assigned if v.rule not in aside]
    violation = r.violation
    if len(deciding) < len(r.assigned) and violation is None and deciding and not r.not_loaded:
        violation = None if any(v.violation is None for v in deciding) else False
    return Outcome(
        policy=r.policy or OPEN,
        prompt=r.prompt or OPEN,
        stage=r.judged_stage or OPEN,
        success=r.success,
        violation=violation,
        judged=bool(r.assigned),
        task=r.task,
        family=r.family,
        seed=r.seed,
        rollout=r.rollout,
        episode_id=r.episode_id,
        at_risk=r.at_risk,
        engagement=r.engagement,
        where=r.path,
    )
