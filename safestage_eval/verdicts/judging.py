"""All loaded rules on one episode: the pure function that everything else wraps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from safestage_eval.episode import Episode, as_judged, describe_holes, with_holes
from safestage_eval.episode.contradictions import contradictions
from safestage_eval.errors import RuleError, readable
from safestage_eval.evidence.at_hand import ReadSoFar
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.store import Store
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import BACKEND, parameters_read, rule_digest
from safestage_eval.rules.episode_binding import Binding, bind_episode
from safestage_eval.units import format_quantity
from safestage_eval.version import __version__

from .consequences import with_consequences
from .decided import is_decided
from .engagement import Engagement, engagement, held_again
from .evaluate import Evaluator
from .explain import inconclusive
from .initial_state import first_frames
from .obligations.cost import judge_cost
from .players import combinations
from .questions import short, verdict_question
from .severity_levels import judge_with_levels
from .success import native_success
from .values import UNDECLARED
from .verdict import CostTotal, EpisodeResult, Vacuity, Verdict, VerdictName
from .verdict_json import to_json, verdict_from_json


def judge(
    episode: Episode,
    rules: ast.RuleSet,
    *,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    trace_hash: str | None = None,
    backend: str = "gjk",
    assigned_only: bool = False,
    store: Store | None = None,
) -> EpisodeResult:
    """Judge one episode by every rule of a set.

    Args:
        episode: what happened.
        rules: what must not happen.
        overrides: parameter → value as written (``{"edge": "3 cm"}``); beats every other source.
        bind: roles, goal, rules and parameters for traces whose header lacks them
            (``rules.load_bind``).
        trace_hash: the episode's content hash, by a caller that computed it; None: as read, or
            computed (``Episode.trace_hash``).
        backend: whose clearances (``geometry.backend``); part of each rule's digest.
        assigned_only: judge only the rules that the episode's task is assigned.
        store: that answers queries about the episode; a new one in memory if None.

    Raises:
        InputError: a backend that does not exist, or is not installed.
        TraceError: a column that a rule needs is broken, or what it rests on contradicts itself:
            header and time stamps, poses and velocities, contacts and shapes, …
        RuleError: an override that does not fit its parameter.
    """
    if bind is not None and bind.bodies:
        episode, store = bind.described(episode), None  # what is stored was measured without it
    binding = bind_episode(rules, episode.header, bind=bind, overrides=overrides or {})
    episode = as_judged(episode)
    judge_ = Judge(episode, rules, binding, backend=backend, store=store)
    result = judge_.result(trace_hash, assigned_only=assigned_only)
    judge_.demand_sound()
    return result


class Judge:
    """One episode and its bindings; evaluators are shared by rules with equal parameters.

    Attributes:
        binding: as given.
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
        *,
        backend: str = "gjk",
        store: Store | None = None,
    ) -> None:
        """Native success is found at once, verdicts when they are asked for.

        ``relations``: of the same episode and baseline, to measure nothing twice; they know their
        backend and store; without them these are the ones given.
        """
        episode = with_holes(episode) if relations is None else relations.episode
        self._episode, self._rules, self.binding = episode, rules, binding
        self._relations = relations or Relations(
            Signals(episode, baseline_frames(rules, episode), backend, store)
        )
        self._backend = self._relations.signals.backend
        self._evaluators: list[Evaluator] = []
        self._params: dict[str, ast.Params] = {}
        self.notes: list[str] = []
        if self._backend != BACKEND:
            self.notes.append(f"clearances as {self._backend} tells them, not certified")
        self.notes += [*binding.warnings(), *describe_holes(episode)]
        if self._relations.blind and episode.header.force_source != "none":
            self.notes.append(self._relations.signals.gaps.about_forces)
        self.notes += self._too_light()
        self.causal = Evaluator(self._relations, rules, binding.params(None), None, causal=True)
        self._success = native_success(episode, binding.goal, self.causal, binding.goal_players())
        self.notes += self._success.notes
        self.success, self.success_known = self._success.told, self._success.known
        frame = self._success.frame
        self.success_time = None if frame is None else float(episode.t[frame])
        self._about_success = short(repr((binding.goal, self._success)))

    def result(
        self, trace_hash: str | None = None, *, assigned_only: bool = False
    ) -> EpisodeResult:
        """All verdicts and costs, or the assigned ones alone, with what tables group by."""

        def asked(code: str) -> bool:
            return not assigned_only or code in self.binding.assigned

        header, rules = self._episode.header, self._rules
        verdicts = [self.verdict(rule) for code, rule in rules.rules.items() if asked(code)]
        costs = [self.cost(cost) for code, cost in rules.costs.items() if asked(code)]
        verdicts += [verdict for _, verdict in costs if verdict is not None]
        meant = [n for v in verdicts for n in v.notes if n.startswith(UNDECLARED) and "?" in n]
        self.notes += dict.fromkeys(meant)
        if self.success and self.binding.goal is not None:
            targets = self.binding.roles.get("target", ())
            self.notes += [
                f"{name} is held again at the end: the goal was reached by letting go for a moment"
                for name in held_again(self.evaluator(self._rules.params), targets)
            ]
        return EpisodeResult(
            episode_id=header.episode_id,
            path=readable(self._episode.path or ""),
            task=header.task,
            stage=header.stage,
            family=self.binding.family,
            policy=header.policy,
            prompt=header.prompt,
            seed=header.seed,
            rollout=header.rollout,
            success=self.success,
            success_time=self.success_time,
            trace_hash=trace_hash or self._episode.trace_hash,
            version=__version__,
            verdicts=tuple(with_consequences(verdicts)),
            notes=tuple(self.notes),
            costs=tuple(total for total, _ in costs),
            engagement=self.engagement,
            not_loaded=tuple(
                code
                for code in self.binding.assigned
                if code not in self._rules.rules.keys() | self._rules.costs.keys()
            ),
        )

    def demand_sound(self) -> None:
        """Raises TraceError where columns that were read from a file cannot all be true."""
        if self._episode.path is None:  # made in memory, mostly of what a rule asks for alone
            return
        if not self._relations.store.opened:  # sound when it was measured
            return
        relations = self._relations
        at_hand = ReadSoFar(relations.signals.gaps, relations.chained)
        for error in contradictions(self._episode, at_hand):
            raise error

    @property
    def engagement(self) -> Engagement | None:
        """How far the rollout got with its target, whatever values ``--set`` gives; None if unknown."""
        evaluator = self.evaluator(self._rules.params)
        targets = self.binding.roles.get("target", ())
        return engagement(evaluator, targets, success=self.success)

    def verdict(self, rule: ast.Rule) -> Verdict:
        """Verdict of a rule, with the worst level that is violated too."""
        blank, players = self._start(rule)
        if blank.vacuity:
            return blank
        store = self._relations.store
        if not store.lasting:
            return self._judged(rule, blank, players)
        asked = verdict_question(self._rules, rule, blank, players, self._about_success)
        return verdict_from_json(
            store.answer(asked, lambda: to_json(self._judged(rule, blank, players)))
        )

    def _judged(
        self, rule: ast.Rule, blank: Verdict, players: Mapping[str, Sequence[str]]
    ) -> Verdict:
        return judge_with_levels(self.evaluator(self._values(rule)), rule, players, blank)

    def outline(self, rule: ast.Rule) -> Verdict:
        """Like ``verdict``, but only decides whether it is inconclusive: decided ones come out as a pass."""
        blank, players = self._start(rule)
        if not blank.vacuity and is_decided(self.evaluator(self._values(rule)), rule, players):
            return replace(blank, verdict="pass")
        return self.verdict(rule)

    def cost(self, cost: ast.Cost) -> tuple[CostTotal, Verdict | None]:
        """Total of a cost, and its verdict if it has a budget."""
        blank, players = self._start(cost)
        params = self._values(cost)
        evaluator = self.evaluator(params)
        if blank.vacuity:
            limit = None if cost.budget is None else evaluator.number(cost.budget, {})
            total = CostTotal(
                cost.code, cost.title, cost.stage, blank.assigned, limit,
                notes=blank.notes, sources=blank.sources, rule_digest=blank.rule_digest,
            )  # fmt: skip
            return total, None if limit is None else blank
        total, judged = judge_cost(evaluator, cost, players, blank)
        if judged is None or judged.verdict != "violation":
            return total, judged
        for level, values in cost.severity:
            stricter = evaluator.under({**params, **dict(values)})
            verdict = judge_cost(stricter, cost, players, blank)[1]
            if verdict is not None and verdict.verdict == "violation":
                by_level = (*judged.breaches_by_level, (level, verdict.breaches))
                judged = replace(judged, severity=level, breaches_by_level=by_level)
        return total, judged

    def _start(self, rule: ast.Scoped) -> tuple[Verdict, Mapping[str, Sequence[str]]]:
        """The verdict's fixed fields, with its ``vacuity`` if a role is not played; and the players."""
        players = self.binding.players(rule, self._episode.header)
        self._check_distinct(rule, players)
        params = self._values(rule)
        used = parameters_read(self._rules, rule) if self.binding.overridden else ()
        digest = rule_digest(self._rules, rule, params, self._backend)
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
            f"task {self._episode.header.task or 'without a name'}, rule {rule.code}",
            f"its roles need different bodies, but {' and '.join(shared)}.",
            "a body of its own for each role",
            "correct the roles in the trace header, the rule file or a bind file",
        )

    def evaluator(self, params: ast.Params) -> Evaluator:
        """The language's meaning on the episode under given parameter values."""
        for known in self._evaluators:  # equal values are mostly the same objects: soon compared
            if known.params == params:
                return known
        evaluator = Evaluator(
            self._relations,
            self._rules,
            params,
            self._success.frame,
            success_known=self._success.known,
        )
        self._evaluators.append(evaluator)
        return evaluator

    def _values(self, rule: ast.Scoped) -> ast.Params:
        """The parameters as they hold for a rule."""
        if rule.code not in self._params:
            self._params[rule.code] = self.binding.params(rule)
        return self._params[rule.code]

    def _too_light(self) -> list[str]:
        """A warning that names the objects whose own weight is no contact."""
        header, least = self._episode.header, self.binding.params(None).get("contact_force")
        if least is None or self._relations.blind:
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
