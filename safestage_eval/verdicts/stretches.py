"""Where a rule is judged: whether it applies to some bodies, and in which stretches of frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.states import scope as scopes
from safestage_eval.states.scope import Scope

from .evaluate import Evaluator
from .initial_state import initial_state
from .players import where_it_counts
from .questions import Stretch, stretches_from_json, stretches_to_json
from .spans import may_recur, spans
from .values import Env


def applies(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> bool | None:
    """Whether ``given`` holds at the start for these bodies; None where that is not known."""
    given = rule.given
    if given is None:
        return True

    def found() -> bool | None:
        lower, upper = initially(evaluator, given, env)
        return True if lower >= 0 else None if upper >= 0 else False

    applicable: bool | None = evaluator.recall("given", given, env, found)
    return applicable


def stretches(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Stretch]:
    """The frames that are judged, and for each stretch the frame at which ``until`` ended it."""
    where = (rule.during, rule.at, rule.until)
    if not evaluator.store.lasting:
        named = [env.get(role) for role in where_it_counts(rule)]
        return evaluator.once(
            where, ("stretches", id(rule), *named), _stretches, evaluator, rule, env
        )
    question = "stretches to reach something in" if _met_once(rule) else "stretches"

    def found() -> list[Any]:
        return stretches_to_json(_stretches(evaluator, rule, env))

    return stretches_from_json(evaluator.recall(question, where, env, found))


def _stretches(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Stretch]:
    out: list[Stretch] = []
    stop = None if rule.until is None else evaluator.truth(rule.until, env)
    for scope in _scopes(evaluator, rule, env):
        if stop is None:
            out.append((scope, None))
            continue
        ended = stop.sure[scope.first : scope.stop].nonzero()[0]
        freed = scope.first + int(ended[0]) if len(ended) else None
        out += [(part, freed) for part in scopes.until([scope], stop)]
    # a stretch that is cut leaves the verdict open already, but may have reached what it must
    open_ = any(scope.cut for scope, _ in out) and not _met_once(rule)
    if evaluator.truncated and _may_come(evaluator, rule) and not open_:
        out.append((Scope(evaluator.frames, evaluator.frames, True), None))
    return out


def _met_once(rule: ast.Scoped) -> bool:
    """Some obligation is met by what holds at one moment."""
    return isinstance(rule, ast.Rule) and any(CLAUSES[c.kind].once for c in rule.clauses)


def initially(evaluator: Evaluator, condition: ast.Condition, env: Env) -> tuple[float, float]:
    """Bounds of the margin with which a condition holds in most of the first frames."""
    initial, wanted = initial_state(evaluator, env), None
    if initial is None:
        return -np.inf, np.inf
    if evaluator.asks_costly(condition):
        wanted = initial.mask(evaluator.frames)
    return initial.most_of(evaluator.obliged(None, evaluator.alternative, condition, env, wanted))


def _scopes(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Scope]:
    if rule.at is not None:
        if rule.at.kind == "end":
            return [Scope(evaluator.frames - 1, evaluator.frames, evaluator.truncated)]
        return scopes.at(evaluator.moments(rule.at, env))
    return spans(evaluator, rule.during or ast.Whole(), env)


def _may_come(evaluator: Evaluator, rule: ast.Scoped) -> bool:
    """A scope of the rule may begin where the trace is not known any more."""
    if rule.at is not None:
        return may_recur(ast.Around("after", ast.Duration(1, frames=True), rule.at), evaluator)
    return may_recur(rule.during or ast.Whole(), evaluator)
