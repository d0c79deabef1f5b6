"""All loaded rules on one episode: the pure function that everything else wraps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from safestage_eval import __version__
from safestage_eval.episode import Episode
from safestage_eval.errors import RuleError
from safestage_eval.relations.measure import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import BACKEND, reached, rule_digest
from safestage_eval.rules.resolve import Binding, bind_episode
from safestage_eval.signals.measure import Signals
from safestage_eval.units import format_quantity

from .cost import judge_cost
from .evaluate import Evaluator
from .goal import Reached, first_success
from .memory import Memory, remembered
from .players import combinations
from .rule_verdict import judge_rule, violates
from .values import ends_early, frame_count
from .verdict import CostTotal, EpisodeResult, Verdict

Params = Mapping[str, ast.Quantity | ast.Duration]

STAGES = ("ISH", "ETS", "FSH")


def judge(
    episode: Episode,
    rules: ast.RuleSet,
    *,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    trace_hash: str | None = None,
    backend: str = "gjk",
    assigned_only: bool = False,
    memory: Memory | None = None,
) -> EpisodeResult:
    """Judge one episode by every rule of a set.

    Args:
        episode: what happened.
        rules: what must not happen.
        overrides: parameter → value as written (``{"edge": "3 cm"}``); beats every other source.
        bind: roles, goal, rules and parameters for traces whose header lacks them
            (``rules.load_bind``).
        trace_hash: the episode's content hash if it is known; computing it reads every column.
        backend: whose clearances (``geometry.backend``); part of each rule's digest.
        assigned_only: judge only the rules that the episode's task is assigned.
        memory: where what was measured before is found.

    Raises:
        InputError: a backend that does not exist, or is not installed.
        TraceError: a column that a rule needs is broken.
        RuleError: an override that does not fit its parameter.
    """
    binding = bind_episode(rules, episode.header, bind=bind, overrides=overrides or {})
    relations = None
    if memory is not None:
        relations = memory.relations(baseline_frames(rules, episode), backend)
    judge_ = Judge(episode, rules, binding, relations, backend=backend, memory=memory)
    return judge_.result(trace_hash, assigned_only=assigned_only)


class Judge:
    """One episode and its bindings; evaluators are shared by rules with equal parameters."""

    def __init__(
        self,
        episode: Episode,
        rules: ast.RuleSet,
        binding: Binding,
        relations: Relations | None = None,
        *,
        backend: str = "gjk",
        memory: Memory | None = None,
    ) -> None:
        """Native success is found at once, verdicts when they are asked for.

        ``relations``: of the same episode and baseline, to measure nothing twice; they know their
        backend, without them it is the one given. ``memory``: to judge no rule twice.
        """
        self._memory = memory
        self._episode, self._rules, self._binding = episode, rules, binding
        self._relations = relations or Relations(
            Signals(episode, baseline_frames(rules, episode), backend)
        )
        self._backend = self._relations.signals.backend
        self._evaluators: dict[tuple[tuple[str, Any], ...], Evaluator] = {}
        self.notes: list[str] = []
        if self._backend != BACKEND:
            self.notes.append(f"clearances as {self._backend} tells them, not certified")
        self.notes += self._too_light()
        self._ahead = False  # success comes after the trace's last frame
        self._success_frame, self.success = self._native_success()
        self.success_time = (
            None if self._success_frame is None else float(episode.t[self._success_frame])
        )

    def result(
        self, trace_hash: str | None = None, *, assigned_only: bool = False
    ) -> EpisodeResult:
        """All verdicts and costs, or the assigned ones alone, with what tables group by."""

        def asked(code: str) -> bool:
            return not assigned_only or code in self._binding.assigned

        header, rules = self._episode.header, self._rules
        verdicts = [self.verdict(rule) for code, rule in rules.rules.items() if asked(code)]
        costs = [self.cost(cost) for code, cost in rules.costs.items() if asked(code)]
        verdicts += [verdict for _, verdict in costs if verdict is not None]
        return EpisodeResult(
            episode_id=header.episode_id,
            path=str(self._episode.path or ""),
            task=header.task,
            stage=header.stage,
            family=self._binding.family,
            policy=header.policy,
            prompt=header.prompt,
            seed=header.seed,
            rollout=header.rollout,
            success=self.success,
            success_time=self.success_time,
            trace_hash=trace_hash or self._episode.content_hash,
            version=__version__,
            verdicts=tuple(_with_consequences(verdicts)),
            notes=tuple(self.notes),
            costs=tuple(total for total, _ in costs),
            not_loaded=tuple(
                code
                for code in self._binding.assigned
                if code not in self._rules.rules.keys() | self._rules.costs.keys()
            ),
        )

    def verdict(self, rule: ast.Rule) -> Verdict:
        """What a rule says, with the worst level that is violated too."""
        blank, players = self._start(rule)
        if blank.notes:
            return blank
        if self._memory is None:
            return self._judged(rule, blank, players)
        success = (self._binding.goal, self.success, self.success_time, self._ahead)
        said = self._rules.digests.get(("said", rule.code))
        if said is None:
            said = self._rules.digests["said", rule.code] = repr(rule)
        asked = f"verdict {said} {blank} {sorted(players.items())} {success}"
        return self._memory.verdict(asked, lambda: self._judged(rule, blank, players))

    def _judged(
        self, rule: ast.Rule, blank: Verdict, players: Mapping[str, Sequence[str]]
    ) -> Verdict:
        params = self._binding.params(rule)
        evaluator = self.evaluator(params)
        found = judge_rule(evaluator, rule, players, blank)
        if found.verdict != "violation":
            return found
        for level, values in rule.severity:
            if violates(evaluator.under({**params, **dict(values)}), rule, players):
                found = replace(found, severity=level)
        return found

    def cost(self, cost: ast.Cost) -> tuple[CostTotal, Verdict | None]:
        """What a cost comes to, and its verdict if it has a budget."""
        blank, players = self._start(cost)
        params = self._binding.params(cost)
        evaluator = self.evaluator(params)
        if blank.notes:
            limit = None if cost.budget is None else evaluator.number(cost.budget, {})
            total = CostTotal(
                cost.code, cost.title, cost.stage, blank.assigned, limit,
                notes=blank.notes, sources=blank.sources, rule_digest=blank.rule_digest,
            )  # fmt: skip
            return total, None if limit is None else blank
        total, found = judge_cost(evaluator, cost, players, blank)
        if found is None or found.verdict != "violation":
            return total, found
        for level, values in cost.severity:
            stricter = evaluator.under({**params, **dict(values)})
            verdict = judge_cost(stricter, cost, players, blank)[1]
            if verdict is not None and verdict.verdict == "violation":
                found = replace(found, severity=level)
        return total, found

    def _start(self, rule: ast.Scoped) -> tuple[Verdict, Mapping[str, Sequence[str]]]:
        """The verdict's fixed fields, with a note if a role is not played; and the players."""
        players = self._binding.players(rule, self._episode.header)
        self._check_distinct(rule, players)
        params = self._binding.params(rule)
        used = reached(self._rules, rule, params) if self._binding.overridden else {}
        missing = [name for name, bodies in players.items() if not bodies]
        blank = Verdict(
            rule.code,
            rule.title,
            rule.stage,
            rule.code in self._binding.assigned,
            "not_applicable",
            vacuity="no_player" if missing else None,
            notes=(f"no body plays {', '.join(missing)}",) if missing else (),
            sources=self._binding.sources(
                rule, [name.removeprefix("param.") for name in used if name.startswith("param.")]
            ),
            rule_digest=rule_digest(self._rules, rule, params, self._backend),
        )
        return blank, players

    def _check_distinct(self, rule: ast.Scoped, players: Mapping[str, Sequence[str]]) -> None:
        """Refuse roles of an assigned rule that are bound so that one body would play two."""
        bound = [name for name, _ in rule.roles if self._binding.roles.get(name) and players[name]]
        found = next(combinations(rule, players, bound), None)
        if found is not None or rule.code not in self._binding.assigned:
            return
        told = [f"{name} = {', '.join(players[name])}" for name in bound]
        raise RuleError(
            f"task {self._episode.header.task or 'without a name'}, rule {rule.code}",
            f"its roles need different bodies, but {' and '.join(told)}.",
            "a body of its own for each role",
            "correct the roles in the trace header, the rule file or a bind file",
        )

    def evaluator(self, params: Params) -> Evaluator:
        """The language's meaning on the episode under given parameter values."""
        key = tuple(sorted(params.items()))
        if key not in self._evaluators:
            self._evaluators[key] = Evaluator(
                self._relations,
                self._rules,
                params,
                self._success_frame,
                success_known=self.success is False
                or self._success_frame is not None
                or self._ahead,
                memory=self._memory,
            )
        return self._evaluators[key]

    def _too_light(self) -> list[str]:
        """A warning that names the objects whose own weight is no contact."""
        header, least = self._episode.header, self._binding.params(None).get("contact_force")
        if least is None or header.force_source == "none":
            return []
        gravity, force = float(np.linalg.norm(header.gravity)), _size(least)
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

    def _native_success(self) -> tuple[int | None, bool | None]:
        """Frame and truth of native success; recorded wins, a disagreement is noted.

        The frame is None where there was no success or its moment is not in the trace.
        """
        header, t = self._episode.header, self._episode.t
        recorded = None
        if header.success and header.success_time is not None:
            if header.success_time > t[-1] + 1e-6:
                self.notes.append(
                    f"the trace ends at {t[-1]:.2f} s, before its success at {header.success_time:.2f} s"
                )
                self._ahead = True
                return None, True
            recorded = int(np.searchsorted(t, header.success_time - 1e-6))
        if self._binding.goal is None:
            return recorded, header.success
        reached = self._goal_reached(self._binding.goal, recorded)
        if header.success is None:
            unsure = reached.unsure or (reached.frame is None and ends_early(self._episode))
            return reached.frame, None if unsure else reached.frame is not None
        if header.success and recorded is None:
            return reached.frame, True
        if not reached.unsure:
            self._compare(recorded, reached.frame)
        return recorded, header.success

    def _goal_reached(self, goal: ast.GoalDef, recorded: int | None) -> Reached:
        """The frame that confirms the goal; ``recorded`` is the one that the trace names."""
        evaluator = Evaluator(
            self._relations,
            self._rules,
            self._binding.params(None),
            None,
            causal=True,
            memory=self._memory,
        )
        evaluator.players = self._binding.goal_players()
        found = remembered(
            evaluator,
            f"goal, recorded {recorded}",
            goal,
            {},
            lambda: [*first_success(evaluator, goal, evaluator.players, hint=recorded)],
        )
        return Reached(*found)

    def _compare(self, recorded: int | None, recomputed: int | None) -> None:
        """Note a disagreement between the recorded success and the goal of the trace."""
        t = self._episode.t
        if recorded is None and recomputed is not None:
            at = f"{t[recomputed]:.2f} s"
            self.notes.append(f"recorded as no success, but the goal was reached at {at}")
        elif recorded is not None and recomputed is None:
            self.notes.append("recorded as success, but the goal is never reached in the trace")
        elif recorded is not None and recomputed is not None and abs(recomputed - recorded) > 1:
            said, found = f"{t[recorded]:.3f} s", f"{t[recomputed]:.3f} s"
            self.notes.append(f"recorded success at {said}, goal reached at {found}")


def baseline_frames(rules: ast.RuleSet, episode: Episode) -> int:
    """How many first frames estimate the initial state: ``[baseline] span``.

    Raises RuleError for a span that is not the first stretch of the episode.
    """
    span = rules.baseline
    if (
        isinstance(span, ast.Part)
        and span.which == "first"
        and isinstance(span.of, ast.Whole)
        and isinstance(span.duration, ast.Duration)
    ):
        return max(1, frame_count(span.duration, episode.dt))
    raise RuleError("[baseline] span", "not a first stretch.", '"first 5 frames of episode"')


def _size(value: ast.Quantity | ast.Duration) -> float:
    return value.value if isinstance(value, ast.Quantity) else value.amount


def _with_consequences(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Mark violations that follow the assigned rule's own, at its stage or a later one."""
    causes = [v for v in verdicts if v.assigned and v.verdict == "violation" and v.time is not None]
    if not causes:
        return list(verdicts)
    cause = min(causes, key=lambda v: v.time or 0.0)
    order = {stage: i for i, stage in enumerate(STAGES)}
    return [
        replace(v, consequence_of=cause.rule)
        if not v.assigned
        and v.verdict == "violation"
        and v.time is not None
        and v.time >= (cause.time or 0.0)
        and order.get(v.stage, 0) >= order.get(cause.stage, 0)
        else v
        for v in verdicts
    ]
