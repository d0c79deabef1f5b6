"""One rule on one combination of bodies: its margin in each scope, and the frames that break it."""

from __future__ import annotations

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import TINY, Band, Bool
from safestage_eval.states.persistence import held_from, without_short_runs
from safestage_eval.states.scope import Scope

from .brief import condition_within, is_brief
from .evaluate import Evaluator
from .greatest import greatest
from .instance import Instance
from .stretches import applies, stretches
from .values import Env


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
    found = [
        judge_scope(evaluator, rule, env, scope, resolved, number)
        for number, (scope, resolved) in enumerate(stretches(evaluator, rule, env))
    ]
    if given is None:
        # it is no violation if it does not apply, and none if nothing breaks it
        found = [i if i.lower >= 0 else i._replace(upper=np.inf, clause=None) for i in found]
        if any(i.clause is None for i in found):
            evaluator.notes["whether it applies is not known: its given is not, at the start"] = (
                None
            )
    return found


def violated_frames(evaluator: Evaluator, rule: ast.Rule, instance: Instance) -> Bool:
    """(T,) the frames of the scope in which some obligation is certainly broken."""
    out = np.zeros(evaluator.frames, np.bool_)
    first, stop, _, _ = instance.scope
    sure = instance.scope.certain
    lasting = evaluator.window(rule.for_).within(first, stop)
    for clause in rule.clauses:
        found = evaluator.only_signs(_inside, evaluator, clause, instance.env, instance.scope)
        if clause.kind == "require":
            out[first:stop] |= found.false & sure
        elif clause.kind == "forbid":
            held = np.where(sure, found.lower, -np.inf)
            out[first:stop] |= without_short_runs(held, lasting) >= 0
        elif held_from(found.upper, lasting.loose).max(initial=-np.inf) < 0:
            out[first:stop] = True
    return out


def _mask(evaluator: Evaluator, scope: Scope) -> Bool:
    mask = np.zeros(evaluator.frames, np.bool_)
    mask[scope.first : scope.stop] = True
    return mask


def _band(
    evaluator: Evaluator,
    what: ast.Alternative,
    env: Env,
    scope: Scope,
    kind: ast.ClauseKind | None = None,
) -> Band:
    """The band (T,) of an obligation, of which only the scope's frames mean anything."""
    wanted = _mask(evaluator, scope) if evaluator.asks_costly(what) else None
    return evaluator.obliged(kind, evaluator.alternative, what, env, wanted)


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
        lower, upper, frame = _decided(evaluator, rule, clause, env, scope, number)
        if scope.cut and clause.kind == "reach":
            upper = np.inf
        elif scope.cut:
            lower = -np.inf
        results.append((lower, upper, clause, scope.first + frame))
    if len(results) == 1:
        return Instance(env, scope, *results[0], resolved, number)
    violated = any(upper < 0 for _, upper, _, _ in results)
    decisive = min(results, key=lambda r: r[1] if violated else r[0])
    lower, upper = min(r[0] for r in results), min(r[1] for r in results)
    return Instance(env, scope, lower, upper, decisive[2], decisive[3], resolved, number)


def _decided(
    evaluator: Evaluator, rule: ast.Rule, clause: ast.Clause, env: Env, scope: Scope, number: int
) -> tuple[float, float, int]:
    """As ``_obligation``, of one of the rule's in one of its scopes; once."""
    parts = (clause.what, rule.for_, rule.during, rule.at, rule.until)
    key = (clause.kind, number, id(rule), *env.items())
    return evaluator.once(parts, key, _decide, evaluator, rule, clause, env, scope)


def _decide(
    evaluator: Evaluator, rule: ast.Rule, clause: ast.Clause, env: Env, scope: Scope
) -> tuple[float, float, int]:
    costly = clause.kind == "forbid" and evaluator.asks_costly(clause.what)
    if costly and rule.for_ is None and scope.stop > scope.first:
        low, high, frame = greatest(evaluator, clause.what, env, scope)
        return negated_margin(high), negated_margin(low), frame
    lasting = evaluator.window(rule.for_).within(scope.first, scope.stop)
    inside = _inside(evaluator, clause, env, scope)
    return _obligation(clause.kind, inside, scope.sure, lasting)


def _inside(evaluator: Evaluator, clause: ast.Clause, env: Env, scope: Scope) -> Band:
    """The band (stop − first,) of an obligation in a scope."""
    what, first, stop = clause.what, scope.first, scope.stop
    if clause.kind == "require" and type(what) is ast.Condition and is_brief(evaluator, scope):
        wanted = _mask(evaluator, scope) if evaluator.asks_costly(what) else None
        return evaluator.obliged(
            clause.kind, condition_within, evaluator, what, env, first, stop, wanted
        )
    return _band(evaluator, what, env, scope, clause.kind).at(first, stop)


def _obligation(
    kind: ast.ClauseKind, found: Band, sure: Bool | None, lasting: Window
) -> tuple[float, float, int]:
    """Bounds of one obligation's margin within a scope, and the frame (from its start) it rests on.

    ``sure``: which frames are certainly judged; only they can violate, but all must pass.
    """
    if not len(found.lower):
        nothing = -np.inf if kind == "reach" else np.inf
        return nothing, nothing, 0
    if kind == "require":
        upper = found.upper if sure is None else np.where(sure, found.upper, np.inf)
        least, lowest = int(upper.argmin()), int(found.lower.argmin())
        broken = bool(upper[least] < 0)
        return float(found.lower[lowest]), float(upper[least]), least if broken else lowest
    held = found.lower
    if kind == "forbid" and sure is not None:
        held = np.where(sure, found.lower, -np.inf)
    low = held_from(held, lasting)
    exact = held is found.upper and lasting.loose is lasting
    high = low if exact else held_from(found.upper, lasting.loose)
    start = int(low.argmax())
    surely = possibly = float(low[start])
    values = held
    if high is not low:
        start_high = int(high.argmax())
        possibly = float(high[start_high])
        if not surely >= 0:
            start, values, lasting = start_high, found.upper, lasting.loose
    frame = start + int(values[start : lasting.stop(start)].argmin())
    if kind == "forbid":
        return negated_margin(possibly), negated_margin(surely), frame
    if sure is None:
        return surely, possibly, frame
    # a stretch that is not certain may be empty, or several, each of which would have to reach it
    return -np.inf, possibly if sure.any() else np.inf, frame


def negated_margin(margin: float) -> float:
    """As ``states.band.negated``, of a single margin."""
    return -margin if margin != 0 else -TINY
