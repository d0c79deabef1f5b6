"""One rule on one combination of bodies: its margin in each scope, and the frames that break it."""

from __future__ import annotations

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import TINY, Bool
from safestage_eval.states.scope import Scope

from . import event_order
from .evaluate import Evaluator
from .instance import Instance
from .obligations import OBLIGATIONS
from .stretches import applies, stretches
from .values import Env
from .witness import Witness


def judge_instance(evaluator: Evaluator, rule: ast.Rule, env: Env) -> list[Instance] | None:
    """The rule for one combination of bodies, once per scope.

    None when ``given`` did not hold in the baseline: the rule does not apply to these bodies.
    """
    given = applies(evaluator, rule, env)
    if given is False:
        apart = [env[role] for role, spec in rule.roles if spec.every and role in env]
        if apart:
            evaluator.notes[f"not judged of {', '.join(apart)}: its given does not hold there"] = (
                None
            )
        return None
    instances = [
        judge_scope(evaluator, rule, env, scope, resolved, number)
        for number, (scope, resolved) in enumerate(stretches(evaluator, rule, env))
    ]
    instances = [_as_sampled(evaluator, rule, instance) for instance in instances]
    if given is None:
        # it is no violation if it does not apply, and none if nothing breaks it
        instances = [
            i if i.lower >= 0 else i._replace(upper=np.inf, clause=None) for i in instances
        ]
        if any(i.clause is None for i in instances):
            evaluator.notes["whether it applies is not known: its given is not, at the start"] = (
                None
            )
    return instances


def witness_of(
    evaluator: Evaluator, rule: ast.Rule, instance: Instance, *, violated: bool
) -> Witness:
    """The measurement behind an instance's margin, or what an obligation tells before that.

    The instance has a decisive obligation.
    """
    clause = instance.clause
    assert clause is not None
    for kind in (OBLIGATIONS[each.kind] for each in rule.clauses):
        first = kind.first_witness(evaluator, rule, instance, violated=violated)
        if first is not None:
            return first
    decisive = OBLIGATIONS[clause.kind]
    return decisive.witness(evaluator, clause.what, instance, instance.frame, violated=violated)


def undersampled(evaluator: Evaluator, witness: Witness) -> float | None:
    """M by which the value may differ between two frames, if the limit lies within that."""
    if witness.name is None or witness.value is None or witness.limit is None or witness.at_least:
        return None
    slack = evaluator.between_frames(witness.name, witness.bodies, witness.frame)
    if slack is None or abs(witness.value - witness.limit) > slack:
        return None
    return slack


def _as_sampled(evaluator: Evaluator, rule: ast.Rule, instance: Instance) -> Instance:
    """An instance that is met at every sample, but may not be between two that are far apart."""
    frame = instance.frame
    if instance.lower < 0 or instance.clause is None or instance.scope.stop <= frame:
        return instance
    if not evaluator.clock.coarse[max(frame - 1, 0) : frame + 1].any():
        return instance
    witness = witness_of(evaluator, rule, instance, violated=False)
    slack = undersampled(evaluator, witness)
    if slack is None or witness.value is None or witness.limit is None:
        return instance
    apart = max(abs(witness.value - witness.limit), np.finfo(float).tiny)
    lower = min(instance.lower * (1 - slack / apart), -TINY)
    return instance._replace(lower=lower)


def violated_frames(evaluator: Evaluator, rule: ast.Rule, instance: Instance) -> Bool:
    """(T,) the frames of the scope in which some obligation is certainly broken."""
    out = np.zeros(evaluator.frames, np.bool_)
    scope, env = instance.scope, instance.env
    lasting = evaluator.window(rule.for_).within(scope.first, scope.stop)
    for clause in rule.clauses:
        kind = OBLIGATIONS[clause.kind]
        band = evaluator.only_signs(kind.band, evaluator, clause.what, env, scope)
        known = event_order.begun_between(clause.what, scope, evaluator.clock.coarse)
        out[scope.first : scope.stop] |= kind.broken(band, known.certain, lasting)
    return out


def judge_scope(
    evaluator: Evaluator,
    rule: ast.Rule,
    env: Env,
    scope: Scope,
    resolved: int | None,
    number: int,
) -> Instance:
    """The rule in one of its scopes, which is the ``number``-th of these bodies."""
    results = []
    for clause in rule.clauses:
        kind = OBLIGATIONS[clause.kind]
        parts = (clause.what, rule.for_, rule.during, rule.at, rule.until)
        key = (clause.kind, number, id(rule), *env.items())
        margin = evaluator.once(parts, key, kind.margin, evaluator, rule, clause.what, env, scope)
        lower, upper, frame = kind.cut(margin) if scope.cut else margin
        results.append((lower, upper, clause, scope.first + frame))
    if len(results) == 1:
        return Instance(env, scope, *results[0], resolved, number)
    violated = any(upper < 0 for _, upper, _, _ in results)
    decisive = min(results, key=lambda r: r[1] if violated else r[0])
    lower, upper = min(r[0] for r in results), min(r[1] for r in results)
    return Instance(env, scope, lower, upper, decisive[2], decisive[3], resolved, number)
