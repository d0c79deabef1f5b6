"""One rule on one combination of bodies in one scope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states import scope as scopes
from safestage_eval.states.band import Band, Bool, negated
from safestage_eval.states.persistence import held_from, without_short_runs
from safestage_eval.states.scope import Scope

from .evaluate import Env, Evaluator, may_recur

Kind = Literal["require", "forbid", "reach"]


@dataclass(frozen=True)
class Clause:
    """One obligation of a rule."""

    kind: Kind
    what: ast.Alternative


@dataclass(frozen=True)
class Instance:
    """What one combination of bodies came to in one scope.

    Attributes:
        env: role → body.
        scope: the frames that were judged.
        lower, upper: bounds of the margin; negative upper is a violation.
        clause: the decisive obligation; None where something needed is unknown.
        frame: where it is decided.
        resolved: for a rule with ``until``: the frame at which that came, None if never.
    """

    env: Env
    scope: Scope
    lower: float
    upper: float
    clause: Clause | None
    frame: int
    resolved: int | None = None

    @property
    def violated(self) -> bool:
        """Certainly violated."""
        return self.upper < 0

    @property
    def undecided(self) -> bool:
        """Neither certainly violated nor certainly not."""
        return self.lower < 0 <= self.upper


def clauses(rule: ast.Rule) -> list[Clause]:
    """The rule's obligations: all of them must be met."""
    out = [Clause("require", rule.require)] if rule.require is not None else []
    out += [Clause("forbid", what) for what in rule.forbid]
    return out + ([Clause("reach", rule.reach)] if rule.reach is not None else [])


def judge_instance(evaluator: Evaluator, rule: ast.Rule, env: Env) -> list[Instance] | None:
    """The rule for one combination of bodies, once per scope.

    None when ``given`` did not hold in the baseline: the rule does not apply to these bodies.
    """
    given = applies(evaluator, rule, env)
    if given is False:
        return None
    if given is None:
        return [Instance(env, Scope(0, 0), -np.inf, np.inf, None, 0)]
    return [
        _judge_scope(evaluator, rule, env, scope, resolved)
        for scope, resolved in stretches(evaluator, rule, env)
    ]


def applies(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> bool | None:
    """Whether ``given`` holds at the start for these bodies; None where that is not known."""
    evaluator.horizon = evaluator.frames
    if rule.given is None:
        return True
    lower, upper = initially(evaluator, rule.given, env)
    return True if lower >= 0 else None if upper >= 0 else False


def stretches(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[tuple[Scope, int | None]]:
    """The frames that are judged, and for each stretch the frame at which ``until`` ended it."""
    found = _scopes(evaluator, rule, env)
    if rule.until is not None:
        stop = evaluator.truth(rule.until, env)
        ends = [np.flatnonzero(stop[a:b]) for a, b, _ in found]
        resolved = [
            s.first + int(e[0]) if len(e) else None for s, e in zip(found, ends, strict=True)
        ]
        found = scopes.until(found, stop)
    else:
        resolved = [None] * len(found)
    end_known = min(evaluator.horizon, evaluator.frames)
    unseen = end_known < evaluator.frames or evaluator.truncated
    if (
        unseen
        and _may_come(evaluator, rule)
        and not any(s.cut or s.stop > end_known for s in found)
    ):
        found, resolved = [*found, Scope(end_known, end_known, True)], [*resolved, None]
    out = []
    for (first, last, cut), end in zip(found, resolved, strict=True):
        inner = Scope(first, last, cut)
        if last > evaluator.horizon:
            inner = Scope(min(first, evaluator.horizon), evaluator.horizon, True)
        out.append((inner, end))
    return out


def initially(evaluator: Evaluator, condition: ast.Condition, env: Env) -> tuple[float, float]:
    """Bounds of the margin with which a condition holds in most of the baseline frames."""
    count = min(evaluator.frames, evaluator.relations.signals.baseline.frames)
    found = _band(evaluator, condition, env, Scope(0, count))
    return tuple(float(np.sort(end[:count])[(count - 1) // 2]) for end in found)  # type: ignore[return-value]


def violated_frames(evaluator: Evaluator, rule: ast.Rule, instance: Instance) -> Bool:
    """(T,) the frames of the scope in which some obligation is certainly broken."""
    out = np.zeros(evaluator.frames, np.bool_)
    first, stop, _ = instance.scope
    lasting = evaluator.count(rule.for_) if rule.for_ is not None else 1
    for clause in clauses(rule):
        found = _band(evaluator, clause.what, instance.env, instance.scope).at(first, stop)
        if clause.kind == "require":
            out[first:stop] |= found.false
        elif clause.kind == "forbid":
            out[first:stop] |= without_short_runs(found.lower, lasting) >= 0
        elif held_from(found.upper, lasting).max(initial=-np.inf) < 0:
            out[first:stop] = True
    return out


def _mask(evaluator: Evaluator, scope: Scope) -> Bool:
    mask = np.zeros(evaluator.frames, np.bool_)
    mask[scope.first : scope.stop] = True
    return mask


def _scopes(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Scope]:
    if rule.at is not None:
        if rule.at.kind == "end":
            return [Scope(evaluator.frames - 1, evaluator.frames, evaluator.truncated)]
        return [Scope(e, e + 1) for e in evaluator.instants(rule.at, env)]
    return evaluator.spans(rule.during or ast.Whole(), env)


def _may_come(evaluator: Evaluator, rule: ast.Scoped) -> bool:
    """A scope of the rule may begin where the trace is not known any more."""
    if rule.at is not None:
        return may_recur(ast.Around("after", ast.Duration(1, frames=True), rule.at), evaluator)
    return may_recur(rule.during or ast.Whole(), evaluator)


def _band(evaluator: Evaluator, what: ast.Alternative, env: Env, scope: Scope) -> Band:
    """The band (T,) of an obligation, of which only the scope's frames mean anything.

    From the first frame on at which an event that it refers to is not known, it is unknown.
    """
    outer, evaluator.horizon = evaluator.horizon, evaluator.frames
    found = evaluator.alternative(what, env, _mask(evaluator, scope))
    horizon, evaluator.horizon = evaluator.horizon, outer
    if horizon >= evaluator.frames:
        return found
    lower, upper = found.lower.copy(), found.upper.copy()
    lower[horizon:], upper[horizon:] = -np.inf, np.inf
    return Band(lower, upper)


def _judge_scope(
    evaluator: Evaluator, rule: ast.Rule, env: Env, scope: Scope, resolved: int | None
) -> Instance:
    lasting = evaluator.count(rule.for_) if rule.for_ is not None else 1
    results = []
    for clause in clauses(rule):
        whole = _band(evaluator, clause.what, env, scope)
        lower, upper, frame = _obligation(clause.kind, whole.at(scope.first, scope.stop), lasting)
        if scope.cut and clause.kind == "reach":
            upper = np.inf
        elif scope.cut:
            lower = -np.inf
        results.append((lower, upper, clause, scope.first + frame))
    violated = any(upper < 0 for _, upper, _, _ in results)
    decisive = min(results, key=lambda r: r[1] if violated else r[0])
    lower, upper = min(r[0] for r in results), min(r[1] for r in results)
    return Instance(env, scope, lower, upper, decisive[2], decisive[3], resolved)


def _obligation(kind: Kind, found: Band, lasting: int) -> tuple[float, float, int]:
    """Bounds of one obligation's margin within a scope, and the frame (from its start) it rests on."""
    if not len(found.lower):
        nothing = -np.inf if kind == "reach" else np.inf
        return nothing, nothing, 0
    if kind == "require":
        lower, upper = float(found.lower.min()), float(found.upper.min())
        return lower, upper, int(np.argmin(found.upper if upper < 0 else found.lower))
    low, high = held_from(found.lower, lasting), held_from(found.upper, lasting)
    best = low if low.max() >= 0 else high
    start = int(np.argmax(best))
    window = (found.lower if best is low else found.upper)[start : start + lasting]
    frame = start + int(np.argmin(window))
    if kind == "reach":
        return float(low.max()), float(high.max()), frame
    return (
        float(negated(np.asarray(high.max()))),
        float(negated(np.asarray(low.max()))),
        frame,
    )
