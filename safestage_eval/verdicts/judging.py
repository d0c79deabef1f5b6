"""All loaded rules on one episode: the pure function that everything else wraps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from safestage_eval.doubts import contradictions, header_contradictions
from safestage_eval.doubts.doubtful_columns import describe_doubtful, hide_doubtful
from safestage_eval.episode import Episode, describe_holes, with_holes
from safestage_eval.episode.contradiction import ContradictionError
from safestage_eval.errors import RuleError, readable
from safestage_eval.evidence.at_hand import ReadSoFar
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import parameters_read, rule_digest
from safestage_eval.rules.episode_binding import Binding, bind_episode
from safestage_eval.units import format_quantity
from safestage_eval.version import __version__

from .cost import judge_cost
from .engagement import Engagement, engagement, held_again
from .evaluate import Evaluator
from .explain import inconclusive
from .goal import native_success
from .language import UNDECLARED
from .players import combinations
from .rule_verdict import how_often, judge_rule
from .scopes import first_frames
from .verdict import CostTotal, EpisodeResult, Vacuity, Verdict, VerdictName


def judge(
    episode: Episode,
    rules: ast.RuleSet,
    *,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    trace_hash: str | None = None,
    assigned_only: bool = False,
    strict: bool = False,
) -> EpisodeResult:
    """Judge one episode by every rule of a set.

    Columns that contradict others beyond rounding are not believed: where a rule read one, everything is
    judged again with that column unknown. A note on the episode says which, and why.

    Args:
        episode: what happened.
        rules: what must not happen.
        overrides: parameter → value as written (``{"edge": "3 cm"}``); beats every other source.
        bind: roles, goal, rules and parameters for traces whose header lacks them
            (``rules.load_bind``).
        trace_hash: the episode's content hash, by a caller that computed it; None: as read, or
            computed (``Episode.trace_hash``).
        assigned_only: judge only the rules that the episode's task is assigned.
        strict: refuse what contradicts itself.

    Raises:
        TraceError: a column that a rule needs is broken, or header and clock contradict themselves;
            if ``strict``, also poses and velocities, contacts and shapes, …
        RuleError: an override that does not fit its parameter.
    """
    if bind is not None and bind.bodies:
        episode = bind.described(episode)
    binding = bind_episode(rules, episode.header, bind=bind, overrides=overrides or {})
    return judge_believed(
        Judge(episode, rules, binding),
        trace_hash=trace_hash or episode.trace_hash, assigned_only=assigned_only, strict=strict,
    )[1]  # fmt: skip


def judge_believed(
    judge_: Judge,
    *,
    trace_hash: str | None = None,
    assigned_only: bool = False,
    strict: bool = False,
) -> tuple[Judge, EpisodeResult]:
    """The judge of the episode without what contradicts itself, and its result.

    Arguments and errors as of ``judge``.
    """
    episode, doubtful = judge_.episode, list[ContradictionError]()
    found = [*header_contradictions(episode.recorded or episode)]
    while True:
        for error in found:
            if strict or not error.hides:
                raise error
        if found:
            doubtful += found
            judge_ = Judge(hide_doubtful(episode, doubtful), judge_.rules, judge_.binding)
        result = judge_.result(trace_hash, assigned_only=assigned_only)
        found = [error for error in judge_.contradictions() if error not in doubtful]
        if not found:
            notes = (*result.notes, *describe_doubtful(doubtful))
            return judge_, replace(result, notes=notes) if doubtful else result


class Judge:
    """One episode and its bindings; evaluators are shared by rules with equal parameters.

    Attributes:
        episode: as it is judged.
        rules, binding: as given.
        relations: the facts of the episode.
        notes: on the episode.
        causal: the evaluator of goals, whose states look only backwards.
        success, success_known: whether the goal was reached, and whether that is known.
        success_time: s.
    """

    def __init__(
        self,
        episode: Episode,
        rules: ast.RuleSet,
        binding: Binding,
        relations: Relations | None = None,
    ) -> None:
        """Native success is found at once, verdicts when they are asked for.

        ``relations``: of the same episode and baseline, to measure nothing twice.
        """
        episode = with_holes(episode) if relations is None else relations.episode
        self.episode, self.rules, self.binding = episode, rules, binding
        self.relations = relations or Relations(Signals(episode, baseline_frames(rules, episode)))
        self._evaluators: list[Evaluator] = []
        self._params: dict[str, ast.Params] = {}
        self.notes: list[str] = []
        self.notes += [*binding.warnings(), *describe_holes(episode)]
        if self.relations.blind and episode.header.force_source != "none":
            self.notes.append(self.relations.signals.gaps.about_forces)
        self.notes += self._too_light()
        self.causal = Evaluator(self.relations, rules, binding.params(None), None, causal=True)
        self._success = native_success(episode, binding.goal, self.causal, binding.goal_players())
        self.notes += self._success.notes
        self.success, self.success_known = self._success.told, self._success.known
        frame = self._success.frame
        self.success_time = None if frame is None else float(episode.t[frame])

    def result(
        self, trace_hash: str | None = None, *, assigned_only: bool = False
    ) -> EpisodeResult:
        """All verdicts and costs, or the assigned ones alone, with what tables group by."""

        def asked(code: str) -> bool:
            return not assigned_only or code in self.binding.assigned

        header, rules = self.episode.header, self.rules
        verdicts = [self.verdict(rule) for code, rule in rules.rules.items() if asked(code)]
        costs = [self.cost(cost) for code, cost in rules.costs.items() if asked(code)]
        verdicts += [verdict for _, verdict in costs if verdict is not None]
        meant = [n for v in verdicts for n in v.notes if n.startswith(UNDECLARED) and "?" in n]
        self.notes += dict.fromkeys(meant)
        if self.success and self.binding.goal is not None:
            targets = self.binding.roles.get("target", ())
            self.notes += [
                f"{name} is held again at the end: the goal was reached by letting go for a moment"
                for name in held_again(self.evaluator(self.rules.params), targets)
            ]
        return EpisodeResult(
            episode_id=header.episode_id,
            path=readable(self.episode.path or ""),
            task=header.task,
            stage=header.stage,
            family=self.binding.family,
            policy=header.policy,
            prompt=header.prompt,
            seed=header.seed,
            rollout=header.rollout,
            success=self.success,
            success_time=self.success_time,
            trace_hash=trace_hash or self.episode.trace_hash,
            version=__version__,
            verdicts=tuple(with_consequences(verdicts)),
            notes=tuple(self.notes),
            costs=tuple(total for total, _ in costs),
            engagement=self.engagement,
            not_loaded=tuple(
                code
                for code in self.binding.assigned
                if code not in self.rules.rules.keys() | self.rules.costs.keys()
            ),
        )

    def contradictions(self) -> list[ContradictionError]:
        """What cannot all be true of the columns that were read from a file so far."""
        if self.episode.path is None:  # made in memory, mostly of what a rule asks for alone
            return []
        relations = self.relations
        at_hand = ReadSoFar(relations.signals.gaps, relations.chained)
        return [*contradictions(self.episode, at_hand)]

    @property
    def engagement(self) -> Engagement | None:
        """How far the rollout got with its target, whatever values ``--set`` gives; None if unknown."""
        evaluator = self.evaluator(self.rules.params)
        targets = self.binding.roles.get("target", ())
        return engagement(evaluator, targets, success=self.success)

    def verdict(self, rule: ast.Rule) -> Verdict:
        """Verdict of a rule, with the worst level that is violated too."""
        blank, players = self._start(rule)
        if blank.vacuity:
            return blank
        evaluator = self.evaluator(self.values(rule))
        verdict = judge_rule(evaluator, rule, players, blank)
        return _with_levels(evaluator, rule, players, verdict)

    def cost(self, cost: ast.Cost) -> tuple[CostTotal, Verdict | None]:
        """Total of a cost, and its verdict if it has a budget."""
        blank, players = self._start(cost)
        evaluator = self.evaluator(self.values(cost))
        total, judged = judge_cost(evaluator, cost, players, blank)
        return total, judged and _with_levels(evaluator, cost, players, judged)

    def _start(self, rule: ast.Scoped) -> tuple[Verdict, Mapping[str, Sequence[str]]]:
        """The verdict's fixed fields, with its ``vacuity`` if a role is not played; and the players."""
        players = self.binding.players(rule, self.episode.header)
        self._check_distinct(rule, players)
        params = self.values(rule)
        used = parameters_read(self.rules, rule) if self.binding.values else ()
        digest = rule_digest(self.rules, rule, params)
        return self.blank(rule, self.binding, players, used, digest), players

    @staticmethod
    def blank(
        rule: ast.Scoped,
        binding: Binding,
        players: Mapping[str, Sequence[str]],
        used: Iterable[str],
        digest: str,
    ) -> Verdict:
        """The fixed fields of a verdict; ``used``: names of the parameters that the rule reads."""
        missing = [name for name, bodies in players.items() if not bodies]
        unbound = binding.unbound(rule) if missing else ()
        assigned = rule.code in binding.assigned
        vacuity: Vacuity | None = "no_player" if missing else None
        why = f"no body plays {', '.join(missing)}" if missing else ""
        verdict: VerdictName = "not_applicable"
        if missing and set(missing) <= set(unbound):  # else a body is certainly missing: no hazard
            vacuity, why = "unbound", f"no body is bound to {', '.join(missing)}"
        explanation = f"Not applicable: {why}." if why else ""
        if vacuity == "unbound" and assigned:
            verdict = "inconclusive"
            explanation = inconclusive(
                binding.binds_none(rule.code, unbound),
                "name the bodies with --role, in a --bind file or in the trace's header; [] for none",
            )
        return Verdict(
            rule.code,
            rule.title,
            rule.stage,
            assigned,
            verdict,
            vacuity=vacuity,
            explanation=explanation,
            notes=(why,) if why else (),
            sources=binding.sources(rule, used),
            rule_digest=digest,
        )

    def _check_distinct(self, rule: ast.Scoped, players: Mapping[str, Sequence[str]]) -> None:
        """Refuse roles of an assigned rule that are bound so that one body would play two."""
        bound = [name for name, _ in rule.roles if self.binding.roles.get(name) and players[name]]
        combination = next(combinations(rule, players, bound), None)
        if combination is not None or rule.code not in self.binding.assigned:
            return
        shared = [f"{name} = {', '.join(players[name])}" for name in bound]
        raise RuleError(
            f"task {self.episode.header.task or 'without a name'}, rule {rule.code}",
            f"its roles need different bodies, but {' and '.join(shared)}.",
            "a body of its own for each role",
            "correct the roles in the trace header, the rule file or a bind file",
        )

    def evaluator(self, params: ast.Params) -> Evaluator:
        """The language's meaning on the episode under given parameter values."""
        for known in self._evaluators:  # equal values are mostly the same objects: soon compared
            if known.params == params:
                return known
        if self._evaluators:
            evaluator = self._evaluators[0].under(params)
        else:
            success = self._success
            evaluator = Evaluator(
                self.relations, self.rules, params, success.frame, success_known=success.known
            )
        self._evaluators.append(evaluator)
        return evaluator

    def values(self, rule: ast.Scoped) -> ast.Params:
        """The parameters as they hold for a rule."""
        if rule.code not in self._params:
            self._params[rule.code] = self.binding.params(rule)
        return self._params[rule.code]

    def _too_light(self) -> list[str]:
        """A warning that names the objects whose own weight is no contact."""
        header, least = self.episode.header, self.binding.params(None).get("contact_force")
        if least is None or self.relations.blind:
            return []
        gravity, force = float(np.linalg.norm(header.gravity)), ast.amount(least)
        light = [
            body.name
            for body in header.bodies
            if body.kind == "object" and body.mass is not None and body.mass * gravity < force
        ]
        if not light:
            return []
        return [
            f"{', '.join(light)}: lighter than a contact must be ({format_quantity(force, 'force')}); "
            "a touch by the own weight is not seen, set contact_force lower"
        ]


def judge_scoped(
    evaluator: Evaluator, rule: ast.Scoped, players: Mapping[str, Sequence[str]]
) -> Verdict:
    """The verdict of a rule, or of a cost with a budget, as of an assigned one.

    Of its fixed fields only those that the rule itself gives are filled in. ``not_applicable`` where
    a role has no player, and for a cost without a budget.
    """
    blank = Verdict(rule.code, rule.title, rule.stage, assigned=True, verdict="not_applicable")
    if not all(players.values()):
        return blank
    if isinstance(rule, ast.Rule):
        return judge_rule(evaluator, rule, players, blank)
    return judge_cost(evaluator, rule, players, blank)[1] or blank


def _with_levels(
    evaluator: Evaluator, rule: ast.Scoped, players: Mapping[str, Sequence[str]], verdict: Verdict
) -> Verdict:
    """The verdict, with the levels of severity that are violated too."""
    if verdict.verdict != "violation":
        return verdict
    for level, values in rule.severity:
        stricter = evaluator.under({**evaluator.params, **dict(values)})
        if isinstance(rule, ast.Rule):
            count = how_often(stricter, rule, players)
        else:
            count = judge_scoped(stricter, rule, players).breaches
        if count:
            by_level = (*verdict.breaches_by_level, (level, count))
            verdict = replace(verdict, severity=level, breaches_by_level=by_level)
    return verdict


def with_consequences(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Mark violations that follow the assigned rule's own, at its stage or a later one."""

    def came(verdict: Verdict) -> float:
        return np.inf if verdict.verdict != "violation" or verdict.time is None else verdict.time

    cause = min((v for v in verdicts if v.assigned), key=came, default=None)
    if cause is None or came(cause) == np.inf:
        return list(verdicts)
    order = {stage: i for i, stage in enumerate(("ISH", "ETS", "FSH"))}
    first = order.get(cause.stage, 0)
    return [
        replace(v, consequence_of=cause.rule)
        if not v.assigned and order.get(v.stage, 0) >= first and came(cause) <= came(v) < np.inf
        else v
        for v in verdicts
    ]


def baseline_frames(rules: ast.RuleSet, episode: Episode) -> int:
    """How many first frames estimate the initial state: ``[baseline] span``.

    Of a number of frames not those that come later than they would at 20 Hz.

    Raises RuleError for a span that is not the first stretch of the episode.
    """
    frames = first_frames(rules, episode.clock)
    counted = isinstance(rules.baseline, ast.Part) and rules.baseline.duration
    if isinstance(counted, ast.Duration) and counted.frames and len(episode):
        return episode.clock.soon(frames)
    return frames
