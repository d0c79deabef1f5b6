"""Verdicts of rules and costs with their levels of severity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from safestage_eval.rules import syntax as ast

from .evaluate import Evaluator
from .obligations.cost import judge_cost
from .rule_verdict import how_often, judge_rule
from .verdict import Verdict


def judge_with_levels(
    evaluator: Evaluator, rule: ast.Rule, players: Mapping[str, Sequence[str]], blank: Verdict
) -> Verdict:
    """The verdict of a rule, with the levels that are violated too; arguments as ``judge_rule``."""
    verdict = judge_rule(evaluator, rule, players, blank)
    if verdict.verdict != "violation":
        return verdict
    for level, values in rule.severity:
        stricter = evaluator.under({**evaluator.params, **dict(values)})

        def often(stricter: Evaluator = stricter) -> int:
            return how_often(stricter, rule, players)

        count = stricter.recall("breaches", rule, {}, often)
        if count:
            by_level = (*verdict.breaches_by_level, (level, count))
            verdict = replace(verdict, severity=level, breaches_by_level=by_level)
    return verdict


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
