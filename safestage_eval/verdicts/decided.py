"""Whether a verdict is decided, without its measurements: by the signs of margins alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from safestage_eval.rules import syntax as ast
from safestage_eval.states.scope import Scope

from .evaluate import Evaluator
from .obligations import OBLIGATIONS
from .players import combinations
from .stretches import applies, stretches
from .values import Env


def is_decided(evaluator: Evaluator, rule: ast.Rule, players: Mapping[str, Sequence[str]]) -> bool:
    """Whether the verdict of a rule is certainly not inconclusive; arguments as ``judge_rule``.

    Much cheaper than the verdict. False where samples are so far apart that margins matter.
    """
    if evaluator.clock.coarse.any():
        return False
    evaluator.players, evaluator.notes = players, {}
    open_ = False
    for env in combinations(rule, players):
        given = applies(evaluator, rule, env)
        for scope, _ in stretches(evaluator, rule, env) if given is not False else ():
            lower, upper = _signs(evaluator, rule, env, scope)
            if upper < 0 and given:
                return True
            open_ |= lower < 0
    return not open_


def _signs(evaluator: Evaluator, rule: ast.Rule, env: Env, scope: Scope) -> tuple[float, float]:
    """Bounds of the margin in a scope, of which only the signs mean anything."""
    bounds = []
    for clause in rule.clauses:
        kind = OBLIGATIONS[clause.kind]
        margin = evaluator.only_signs(kind.margin, evaluator, rule, clause.what, env, scope)
        bounds.append(kind.cut(margin) if scope.cut else margin)
    return min(bound.lower for bound in bounds), min(bound.upper for bound in bounds)
