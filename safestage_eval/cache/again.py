"""An episode judged again under other values of parameters, without opening or understanding it anew.

What does not depend on values (who plays what, what is assigned, whether the goal was reached) is
kept as an outline. Rules that do not read a changed value keep their verdicts; of the others what
they compare was kept (judged.py).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from safestage_eval.rules import Binding, RuleSet, parse_overrides, rule_digest
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.verdicts import EpisodeResult, Verdict
from safestage_eval.verdicts.judging import Judge, judged
from safestage_eval.verdicts.memory import judged_question, verdict_question

from .memory import Memory
from .outline import ALIKE, read
from .recalled import KeptRelations, NotKept, Recalled

Setting = ast.Quantity | ast.Duration

_MANY = 512
"""Kinds of episodes that are remembered at once."""


def judge_again(
    memory: Memory, rules: RuleSet, overrides: Mapping[str, str] | None, backend: str
) -> EpisodeResult | None:
    """The result under other values; None where something is needed that was not kept.

    Args:
        memory: of the episode.
        rules: the rule set.
        overrides: parameter → value as written.
        backend: whose clearances.

    Raises:
        RuleError: an override that does not fit its parameter.
    """
    kept = memory.outline()
    if kept is None:
        return None
    plan = _plan(rules, kept[ALIKE], overrides or {}, backend)
    if plan is None:
        return None
    again = _Again(memory, rules, kept["success"], backend)
    try:
        return memory.put_together(kept, [again.verdict(part) for part in plan])
    except NotKept:
        return None


@dataclass(frozen=True)
class _Part:
    """What a rule comes to on all episodes of a kind.

    Attributes:
        rule: itself.
        players: role → bodies.
        params: values of parameters.
        blank: the verdict's fixed fields.
        asked: the question that the verdict answers, without what is known of success.
    """

    rule: ast.Rule
    players: Mapping[str, tuple[str, ...]]
    params: Mapping[str, Setting]
    blank: Verdict
    asked: str


def _plan(
    rules: RuleSet, alike: str, overrides: Mapping[str, str], backend: str
) -> list[_Part] | None:
    """Found once for all episodes alike; None where the values reach further than verdicts."""
    plans: dict[Any, list[_Part] | None] = rules.known.setdefault("plans", {})
    key = alike, backend, *overrides.items()
    if key not in plans:
        if len(plans) >= _MANY:
            plans.clear()
        plans[key] = _planned(rules, json.loads(alike), parse_overrides(rules, overrides), backend)
    return plans[key]


def _planned(
    rules: RuleSet, alike: Mapping[str, Any], changed: Mapping[str, Setting], backend: str
) -> list[_Part] | None:
    if not changed.keys().isdisjoint(alike["fixed"]):
        return None
    binding = _binding(rules, alike, changed)
    parts = []
    for code, told in alike["rules"]:
        rule, players = rules.rules[code], {role: tuple(bodies) for role, bodies in told.items()}
        params = binding.params(rule)
        digest = rule_digest(rules, rule, params, backend)
        used = sorted(parameters_read(rules, rule) & binding.overridden)
        blank = Judge.blank(rule, binding, players, used, digest)
        asked = verdict_question(rules, rule, blank, players, "")
        parts.append(_Part(rule, players, params, blank, asked))
    return parts


def _binding(rules: RuleSet, alike: Mapping[str, Any], changed: Mapping[str, Setting]) -> Binding:
    values = {name: read(value) for name, value in alike["values"].items()}
    provenance = {**alike["provenance"], **{f"param.{name}": "--set" for name in changed}}
    roles = {role: tuple(bodies) for role, bodies in alike["roles"].items()}
    assigned = tuple(alike["assigned"])
    return Binding(
        roles, assigned, None, alike["family"], provenance, (), rules, {**values, **changed}
    )


class _Again:
    """Judges the rules of one episode."""

    def __init__(
        self, memory: Memory, rules: RuleSet, success: Sequence[Any], backend: str
    ) -> None:
        self._memory, self._rules, self._backend = memory, rules, backend
        self._success, self._success_known, self._about_success = success

    def verdict(self, part: _Part) -> tuple[str | None, Verdict]:
        """What a rule says now, and where that is kept; as ``Judge.verdict``. Raises NotKept."""
        if part.blank.vacuity:
            return None, part.blank
        key = self._memory.key(part.asked + self._about_success)
        return key, self._memory.verdict_of(key, lambda: self._judged(part))

    def _judged(self, part: _Part) -> Verdict:
        rule, players = part.rule, part.players
        about = judged_question(self._rules, rule, players, self._about_success, self._backend)
        entry = self._memory.judged(about, rule)
        if entry is None:
            raise NotKept(rule.code)
        evaluator = Recalled(
            KeptRelations(entry, self._backend), self._rules, part.params, self._success,
            success_known=self._success_known, memory=self._memory,
        )  # fmt: skip
        return judged(evaluator, rule, players, part.blank)
