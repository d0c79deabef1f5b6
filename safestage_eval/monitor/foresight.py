"""How much of the future a rule must have seen before a violation is certain."""

from __future__ import annotations

from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.look_ahead import Foresight, Look, latest
from safestage_eval.verdicts.obligations import OBLIGATIONS, cost


def foresight(
    rules: ast.RuleSet,
    rule: ast.Scoped,
    params: ast.Params,
    frame_dt: float,
    *,
    blind: bool = False,
) -> Foresight:
    """How far a rule or cost looks ahead; arguments as in ``Look``."""
    look = Look(rules, params, frame_dt, blind=blind)
    if isinstance(rule, ast.Cost):
        return latest([look.scope(rule), cost.foresight(look, rule)])
    clauses = [OBLIGATIONS[c.kind].foresight(look, rule, c.what) for c in rule.clauses]
    return latest([look.scope(rule), *clauses])
