"""An episode judged again under other values of parameters, without opening or understanding it anew.

What does not depend on values (who plays what, what is assigned, whether the goal was reached) is
kept as an outline. Rules that do not read a changed value keep their verdicts; of the others what
they compare was kept (judged.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from safestage_eval.rules import Binding, RuleSet, parse_overrides, rule_digest
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.verdicts import EpisodeResult, Verdict
from safestage_eval.verdicts.judge import Judge, judged, with_consequences
from safestage_eval.verdicts.memory import judged_question, verdict_question

from .memory import Memory
from .outline import read
from .recalled import KeptRelations, NotKept, Recalled
from .stored import result

Setting = ast.Quantity | ast.Duration


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
    changed = _changed(rules, overrides or {})
    if not changed.keys().isdisjoint(kept["fixed"]):
        return None
    binding = _binding(rules, kept, changed)
    again = _Again(memory, rules, binding, kept["success"], backend)
    try:
        verdicts = [again.verdict(rules.rules[code], players) for code, players in kept["rules"]]
    except NotKept:
        return None
    found = result(kept["result"], kept["result"]["path"])
    return replace(found, verdicts=tuple(with_consequences(verdicts)))


def _changed(rules: RuleSet, overrides: Mapping[str, str]) -> Mapping[str, Setting]:
    """Values as written, understood once for all episodes."""
    key = "overrides", *overrides.items()
    known: Mapping[str, Setting] | None = rules.digests.get(key)
    if known is None:
        known = rules.digests[key] = parse_overrides(rules, overrides)
    return known


def _binding(rules: RuleSet, kept: Mapping[str, Any], changed: Mapping[str, Setting]) -> Binding:
    values = {name: read(value) for name, value in kept["values"].items()}
    provenance = {**kept["provenance"], **{f"param.{name}": "--set" for name in changed}}
    roles = {role: tuple(bodies) for role, bodies in kept["roles"].items()}
    assigned = tuple(kept["assigned"])
    return Binding(
        roles, assigned, None, kept["family"], provenance, (), rules, {**values, **changed}
    )


class _Again:
    """Judges the rules of one episode."""

    def __init__(
        self, memory: Memory, rules: RuleSet, binding: Binding, success: Sequence[Any], backend: str
    ) -> None:
        self._memory, self._rules, self._binding = memory, rules, binding
        self._backend = backend
        self._success, self._success_known, self._about_success = success
        self._values = repr(sorted(binding.values.items()))

    def verdict(self, rule: ast.Rule, players: Mapping[str, Sequence[str]]) -> Verdict:
        """What a rule says now; as ``Judge.verdict``. Raises NotKept."""
        params, digest, used = self._meaning(rule)
        blank = Judge.blank(rule, self._binding, players, used, digest)
        if blank.notes:
            return blank
        players = {role: tuple(bodies) for role, bodies in players.items()}
        asked = verdict_question(self._rules, rule, blank, players, self._about_success)

        def find() -> Verdict:
            about = judged_question(self._rules, rule, players, self._about_success, self._backend)
            entry = self._memory.judged(about, rule)
            if entry is None:
                raise NotKept(rule.code)
            evaluator = Recalled(
                KeptRelations(entry, self._backend), self._rules, params, self._success,
                success_known=self._success_known, memory=self._memory,
            )  # fmt: skip
            return judged(evaluator, rule, players, blank)

        return self._memory.verdict(asked, find)

    def _meaning(self, rule: ast.Rule) -> tuple[dict[str, Setting], str, list[str]]:
        """Values, digest and overridden parameters of a rule; found once for all episodes alike."""
        key = "meaning", rule.code, self._backend, self._values
        known: tuple[dict[str, Setting], str, list[str]] | None = self._rules.digests.get(key)
        if known is None:
            params = self._binding.params(rule)
            digest = rule_digest(self._rules, rule, params, self._backend)
            used = sorted(parameters_read(self._rules, rule) & self._binding.overridden)
            known = self._rules.digests[key] = params, digest, used
        return known
