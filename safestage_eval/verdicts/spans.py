"""Spans of the rule language over one episode, as far as they are known."""

from __future__ import annotations

from collections.abc import Sequence

from safestage_eval.rules import syntax as ast
from safestage_eval.states import moment, scope
from safestage_eval.states.scope import Scope

from .evaluate import Evaluator
from .values import Env


def spans(evaluator: Evaluator, span: ast.Span, env: Env) -> list[Scope]:
    """The stretches of frames that a span names, in order."""
    match span:
        case ast.Whole():
            return [Scope(0, evaluator.frames, evaluator.truncated)]
        case ast.PhaseSpan(call):
            phase = evaluator.rules.phases[call.name]
            bodies = tuple(env.get(actual, actual) for actual in call.args)
            key = ("phase", call.name, bodies)
            return evaluator.once(phase, key, lambda: _phase(evaluator, phase, bodies))
        case ast.StateSpan(call):
            truth = moment.truth_of(evaluator.state(call, env))
            return scope.of_truth(truth, truncated=evaluator.unfollowed)
        case ast.Part(which, duration, of):
            part = scope.first_part if which == "first" else scope.last_part
            return part(spans(evaluator, of, env), evaluator.window(duration))
        case ast.Around("after", duration, event):
            moments = evaluator.moments(event, env)
            return scope.after(moments, evaluator.window(duration), evaluator.frames)
        case ast.Around(_, duration, event):
            moments = evaluator.moments(event, env)
            cut = evaluator.truncated and event.kind == "end"
            return scope.before(moments, evaluator.window(duration), cut=cut)
        case ast.FromTo(begin, stop):
            followed = stop.kind == "state"
            found = scope.from_to(
                evaluator.truth(begin, env),
                evaluator.truth(stop, env),
                truncated=evaluator.unfollowed if followed else evaluator.truncated,
            )
            return scope.ended_between(found, evaluator.clock.coarse)
        case ast.While(of, call):
            truth = moment.truth_of(evaluator.state(call, env))
            return scope.within(spans(evaluator, of, env), truth)


def _phase(evaluator: Evaluator, phase: ast.PhaseDef, bodies: Sequence[str]) -> list[Scope]:
    """A declared phase; its fallback where it is empty, both perhaps where that is not known."""
    inner = dict(zip(phase.of, bodies, strict=True))
    scopes = spans(evaluator, phase.span, inner)
    if phase.fallback is None or any(s.exists for s in scopes):
        return scopes
    instead = spans(evaluator, phase.fallback, inner)
    return [*scopes, *(s.perhaps() for s in instead)] if scopes else instead


def may_recur(span: ast.Span, evaluator: Evaluator) -> bool:
    """Another stretch of the span may begin after the trace's last frame."""
    match span:
        case ast.PhaseSpan(call):
            return may_recur(evaluator.rules.phases[call.name].span, evaluator)
        case ast.Part(_, _, of):
            return may_recur(of, evaluator)
        case ast.FromTo(event, _) | ast.Around("after", _, event):
            if event.kind == "success":
                return evaluator.success is None
            return event.kind == "state"
        case ast.StateSpan() | ast.Around() | ast.While():
            return True
    return False
