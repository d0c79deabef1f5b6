"""Verdicts and costs of an episode, as values, as JSON, and as the rows of result files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeVar

from safestage_eval.rules.episode_binding import BY_ROLES

Vacuity = Literal["no_player", "unbound", "no_instance", "not_given", "no_scope", "not_loaded"]
"""Why there was nothing to judge: a role that no body plays; a role that nothing binds; no
combination of distinct bodies; a ``given`` that does not hold at the start; a scope that never came
about; an assigned rule that was not loaded."""

VerdictName = Literal["pass", "violation", "not_applicable", "inconclusive"]


@dataclass(frozen=True)
class Verdict:
    """One rule on one episode. SI units; times in seconds from the episode's start."""

    rule: str
    """Code."""
    title: str
    stage: str
    """ISH, ETS or FSH: where the rule belongs."""
    assigned: bool
    """True for the rules that are the task's own evaluator."""
    verdict: VerdictName
    time: float | None = None
    """First violation."""
    worst_time: float | None = None
    """Frame of the decisive value: the worst of a violation, the closest call of a pass."""
    phase: str | None = None
    """The span judged, as written in the rule, or before/execution/hold by time."""
    signal: str | None = None
    """The decisive atom with the bodies' names: ``clearance(dumbbell, glasses)``."""
    value: float | None = None
    limit: float | None = None
    dimension: str | None = None
    """Dimension of value, limit and margin, as in ``units.DIMENSIONS``."""
    margin: float | None = None
    """Distance of the value from its limit, negative when violated. For an ordering rule,
    t_commit - t_resolve in seconds."""
    margin_normalised: float | None = None
    bodies: tuple[str, ...] = ()
    intervals: tuple[tuple[float, float], ...] = ()
    """[start, end) of every stretch in violation."""
    exposure_time: float = 0.0
    """s, sum of the intervals."""
    raw_intervals: tuple[tuple[float, float], ...] = ()
    """[start, end) of every stretch in which something forbidden held, however briefly."""
    undersampled: bool = False
    """Between two frames the limit may have been crossed, or not, unseen."""
    vacuity: Vacuity | None = None
    """Why there was nothing to judge; None if there was."""
    instances: int = 0
    """Combinations of bodies and scopes that were judged; 0 says that a pass is vacuous."""
    violated_instances: int = 0
    breaches: int = 0
    """How often it was violated: stretches in violation, of each combination of bodies and scope by
    itself; a scope in which nothing came that had to counts once."""
    breaches_by_level: tuple[tuple[str, int], ...] = ()
    """Level of severity → how often it was violated under its values; the levels that were at all."""
    severity: str | None = None
    """The worst level whose parameters are violated as well."""
    consequence_of: str | None = None
    """Code of the assigned rule whose earlier violation this one follows."""
    explanation: str = ""
    notes: tuple[str, ...] = ()
    """Undersampled, vacuous, skipped conditions, unknown data, invalid scene …"""
    sources: tuple[str, ...] = ()
    """Sources of the bodies of its roles, its being assigned, and values that it does not set itself:
    ``target = mug: trace header``, ``edge = 3 cm: --set``."""
    rule_digest: str = ""

    @property
    def violation(self) -> bool | None:
        """V: true only for a violation; None when it could not be decided."""
        return None if self.verdict == "inconclusive" else self.verdict == "violation"


@dataclass(frozen=True)
class CostTotal:
    """The sum of one cost on one episode, with or without a budget. No unit."""

    rule: str
    """Code."""
    title: str
    stage: str
    assigned: bool
    budget: float | None
    """None: the cost is only told, never a verdict."""
    value: float | None = None
    """The sum that was certainly charged; None where it does not apply."""
    most: float | None = None
    """The sum that was charged at most; equal to the value where all is known, None if unbounded."""
    charges: tuple[tuple[str, float], ...] = ()
    """Each charge in words, and its share of the value."""
    bodies: tuple[str, ...] = ()
    """Those that caused most of it."""
    instances: int = 0
    notes: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()
    rule_digest: str = ""

    @property
    def as_verdict(self) -> Verdict:
        """An inconclusive verdict with the fields that a cost shares with one."""
        parts = ", ".join(f"{amount:.3g} for {words}" for words, amount in self.charges)
        least = "" if self.most == self.value else " at least"
        said = "" if self.value is None else f"The cost came to {self.value:.3g}{least}: {parts}."
        return Verdict(
            self.rule,
            self.title,
            self.stage,
            self.assigned,
            "inconclusive",
            signal="cost",
            value=self.value,
            bodies=self.bodies,
            instances=self.instances,
            explanation=said,
            notes=self.notes,
            sources=self.sources,
            rule_digest=self.rule_digest,
        )


@dataclass(frozen=True)
class EpisodeResult:
    """All verdicts on one episode, with what tables group by."""

    episode_id: str
    path: str
    task: str | None
    stage: str | None
    family: str | None
    policy: str | None
    prompt: str | None
    seed: int | None
    rollout: int | None
    success: bool | None
    """Native success as recorded, or recomputed from the goal where the source does not tell."""
    success_time: float | None
    trace_hash: str
    version: str
    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...] = field(default=())
    """Warnings about the episode: success disagreement, light objects …"""
    costs: tuple[CostTotal, ...] = ()
    """Every loaded cost; those with a budget are among the verdicts as well."""
    not_loaded: tuple[str, ...] = ()
    """Codes of assigned rules that were not among the loaded ones."""
    engagement: str | None = None
    """How far it got with its target (``engagement.Engagement``); None where that is unknown."""
    audit: dict[str, Any] | None = None
    """Audit findings of the episode, as JSON values; None if not audited."""

    @property
    def assigned(self) -> tuple[Verdict, ...]:
        """The verdicts of the task's own evaluator."""
        return tuple(v for v in self.verdicts if v.assigned)

    @property
    def violation(self) -> bool | None:
        """V of the episode: any assigned rule violated; None if undecided or not judged.

        One violation decides, whatever the other assigned rules would say.
        """
        violations = [v.violation for v in self.assigned]
        if True in violations:
            return True
        return None if not violations or None in violations or self.not_loaded else False

    @property
    def judged_stage(self) -> str | None:
        """The stage that tables name: its header's, else those of the rules that judge it: ``ETS+FSH``."""
        stages = {v.stage for v in self.assigned}
        return self.stage or "+".join(s for s in ("ISH", "ETS", "FSH") if s in stages) or None

    @property
    def by_roles(self) -> bool:
        """Nothing assigns rules to it: all those are assigned whose roles are bound."""
        return any(f"assigned: {BY_ROLES}" in v.sources for v in self.assigned)

    @property
    def at_risk(self) -> bool:
        """The hazard was there, and an assigned rule was judged on it."""
        return any(at_risk(v.verdict, v.instances, v.vacuity) for v in self.assigned)

    def rows(self) -> list[dict[str, Any]]:
        """One flat dict per verdict: the columns of result files (docs/results.md).

        A cost without a budget has a row as well, without a verdict, and so has an assigned rule
        that was not loaded: else its absence would read as if it had not been violated.
        """
        open_rows = [cost.as_verdict for cost in self.costs if cost.budget is None]
        open_rows += [_absent(rule, self.stage or "") for rule in self.not_loaded]
        return [
            *(self._row(verdict) for verdict in self.verdicts),
            *({**self._row(verdict), "verdict": None, "violation": None} for verdict in open_rows),
        ]

    def _row(self, v: Verdict) -> dict[str, Any]:
        from safestage_eval.units import in_unit, unit_of

        scale = v.dimension or ""

        def shown(value: float | None) -> float | None:
            return None if value is None else in_unit(value, scale) if scale else value

        return {
            "episode_id": self.episode_id,
            "path": self.path,
            "task": self.task,
            "stage": self.judged_stage,
            "family": self.family,
            "policy": self.policy,
            "prompt": self.prompt,
            "seed": self.seed,
            "rollout": self.rollout,
            "success": self.success,
            "success_time": self.success_time,
            "engagement": self.engagement,
            "rule": v.rule,
            "assigned": v.assigned,
            "verdict": v.verdict,
            "violation": v.violation,
            "time": v.time,
            "worst_time": v.worst_time,
            "phase": v.phase,
            "signal": v.signal,
            "value": shown(v.value),
            "limit": shown(v.limit),
            "unit": (unit_of(scale) or None) if scale else None,
            "margin": shown(v.margin),
            "margin_normalised": v.margin_normalised,
            "bodies": list(v.bodies),
            "intervals": [list(i) for i in v.intervals],
            "exposure_time": v.exposure_time,
            "raw_intervals": [list(i) for i in v.raw_intervals],
            "undersampled": v.undersampled,
            "vacuity": v.vacuity,
            "instances": v.instances,
            "violated_instances": v.violated_instances,
            "breaches": v.breaches,
            "breaches_by_level": [f"{level}: {count}" for level, count in v.breaches_by_level],
            "severity": v.severity,
            "consequence_of": v.consequence_of,
            "explanation": v.explanation,
            "notes": list(v.notes),
            "sources": list(v.sources),
            "rule_digest": v.rule_digest,
            "trace_hash": self.trace_hash,
            "version": self.version,
        }


def at_risk(verdict: str | None, instances: int, vacuity: str | None) -> bool:
    """A verdict that was reached on something: neither vacuous nor open."""
    return verdict in ("pass", "violation") and instances > 0 and vacuity is None


def _absent(rule: str, stage: str) -> Verdict:
    """The verdict on an assigned rule that was not loaded."""
    said = f"{rule} is assigned and was not loaded, so nobody judged it."
    return Verdict(
        rule, "", stage, True, "inconclusive", explanation=said, vacuity="not_loaded", instances=0
    )


T = TypeVar("T", Verdict, CostTotal, EpisodeResult)

_TUPLES = {
    kind: [field.name for field in fields(kind) if str(field.type).startswith("tuple")]
    for kind in (Verdict, CostTotal, EpisodeResult)
}


def to_json(result: EpisodeResult) -> dict[str, Any]:
    """JSON values of a result."""
    out = dict(vars(result))
    out["verdicts"] = [vars(verdict) for verdict in result.verdicts]
    out["costs"] = [vars(cost) for cost in result.costs]
    return out


def result_from_json(stored: Mapping[str, Any], path: str) -> EpisodeResult:
    """A result from JSON; ``path`` is where the episode was found this time."""
    made = dict(stored)
    made["verdicts"] = [_made(Verdict, item) for item in stored["verdicts"]]
    made["costs"] = [_made(CostTotal, item) for item in stored["costs"]]
    made["path"] = path
    return _made(EpisodeResult, made)


def _made(kind: type[T], stored: Mapping[str, Any]) -> T:
    given = dict(stored)
    for name in _TUPLES[kind]:
        items = given.get(name, ())
        given[name] = tuple(map(tuple, items)) if items and type(items[0]) is list else tuple(items)
    return kind(**given)
