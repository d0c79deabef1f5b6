"""Where a rule is judged: whether it applies to some bodies, and in which stretches of frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.episode import Clock
from safestage_eval.episode.clock import SURELY
from safestage_eval.errors import RuleError
from safestage_eval.evidence.intervals import F64, Bool, Interval
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES

from . import between_samples, events
from .evaluate import Evaluator
from .events import Scope
from .language import Env
from .players import where_it_counts
from .windows import lasting

Stretch = tuple[Scope, int | None]
"""Frames that are judged, and the frame at which ``until`` ended them."""


def applies(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> bool | None:
    """Whether ``given`` holds at the start for these bodies; None where that is not known."""
    if rule.given is None:
        return True
    lower, upper = initially(evaluator, rule.given, env)
    return True if lower >= 0 else None if upper >= 0 else False


def stretches(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Stretch]:
    """The frames that are judged, and for each stretch the frame at which ``until`` ended it."""
    named = [env.get(role) for role in where_it_counts(rule)]
    where = (rule.during, rule.at, rule.until)
    key = "stretches", id(rule), *named
    return evaluator.once(where, key, lambda: _stretches(evaluator, rule, env))


def _stretches(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Stretch]:
    out: list[Stretch] = []
    stop = None if rule.until is None else evaluator.truth(rule.until, env)
    for each in _scopes(evaluator, rule, env):
        if stop is None:
            out.append((each, None))
            continue
        ended = stop.true[each.first : each.stop].nonzero()[0]
        freed = each.first + int(ended[0]) if len(ended) else None
        out += [(part, freed) for part in events.until([each], stop)]
    # a stretch that is cut leaves the verdict open already, but may have reached what it must
    open_ = any(part.cut for part, _ in out) and not _met_once(rule)
    if evaluator.truncated and _may_come(evaluator, rule) and not open_:
        out.append((Scope(evaluator.frames, evaluator.frames, True), None))
    return out


def _met_once(rule: ast.Scoped) -> bool:
    """Some obligation is met by what holds at one moment."""
    return isinstance(rule, ast.Rule) and any(CLAUSES[c.kind].once for c in rule.clauses)


def initially(evaluator: Evaluator, condition: ast.Condition, env: Env) -> tuple[float, float]:
    """Bounds of the margin with which a condition holds in most of the first frames."""
    initial = initial_state(evaluator, env)
    if initial is None:
        return -np.inf, np.inf
    found = evaluator.evaluate(condition, env, None, initial.mask(evaluator.frames))
    return initial.most_of(found.margin)


def _scopes(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> list[Scope]:
    if rule.at is not None:
        if rule.at.kind == "end":
            return [Scope(evaluator.frames - 1, evaluator.frames, evaluator.truncated)]
        return events.at(evaluator.moments(rule.at, env))
    return spans(evaluator, rule.during or ast.Whole(), env)


def _may_come(evaluator: Evaluator, rule: ast.Scoped) -> bool:
    """A scope of the rule may begin where the trace is not known any more."""
    if rule.at is not None:
        return may_recur(ast.Around("after", ast.Duration(1, frames=True), rule.at), evaluator)
    return may_recur(rule.during or ast.Whole(), evaluator)


def spans(evaluator: Evaluator, span: ast.Span, env: Env) -> list[Scope]:
    """The stretches of frames that a span names, in order."""
    match span:
        case ast.Whole():
            return [Scope(0, evaluator.frames, evaluator.truncated)]
        case ast.PhaseSpan(call):
            phase = evaluator.rules.phases[call.name]
            bodies = tuple(env.get(actual, actual) for actual in call.args)
            key = "phase", *bodies
            return evaluator.once(phase, key, lambda: _phase(evaluator, phase, bodies))
        case ast.StateSpan(call):
            held = evaluator.state(call, env).margin
            return events.of_truth(held, truncated=evaluator.unfollowed)
        case ast.Part(which, duration, of):
            part = events.first_part if which == "first" else events.last_part
            return part(spans(evaluator, of, env), evaluator.window(duration))
        case ast.Around("after", duration, event):
            moments = evaluator.moments(event, env)
            return events.after(moments, evaluator.window(duration), evaluator.frames)
        case ast.Around(_, duration, event):
            moments = evaluator.moments(event, env)
            cut = evaluator.truncated and event.kind == "end"
            return events.before(moments, evaluator.window(duration), cut=cut)
        case ast.FromTo(begin, stop):
            followed = stop.kind == "state"
            found = events.from_to(
                evaluator.truth(begin, env),
                evaluator.truth(stop, env),
                truncated=evaluator.unfollowed if followed else evaluator.truncated,
            )
            return between_samples.ended_between(found, evaluator.clock.coarse)
        case ast.While(of, call):
            held = evaluator.state(call, env).margin
            return events.within(spans(evaluator, of, env), held)


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


class InitialState(NamedTuple):
    """The frames that show it.

    Attributes:
        first, stop: these frames.
        last: the frame behind all those that rules name, which may come late.
        missing: how many of these a hole took away.
        coarse: much may have happened between two of them.
    """

    first: int
    stop: int
    last: int
    missing: int = 0
    coarse: bool = False

    def mask(self, frames: int) -> Bool:
        """(T,) true in all these frames."""
        at = np.arange(frames)
        return np.asarray((at >= self.first) & (at < self.last))

    def most_of(self, band: Interval) -> tuple[float, float]:
        """Both ends of the margin with which a condition (T,) holds in most of these frames.

        That it does not must have been seen: what is missing may have shown it, and of samples that are
        far apart one that shows it stands for long enough.
        """
        here = slice(self.first, self.stop)
        low = _middle(band.lower[here])
        high = _middle(np.append(band.upper[here], np.full(self.missing, np.inf)))
        if self.coarse:
            high = max(high, float(band.upper[self.first : self.last].max()))
        return low, high


def _middle(ends: F64) -> float:
    return float(np.sort(ends)[(len(ends) - 1) // 2])


def initial_state(evaluator: Evaluator, env: Env) -> InitialState | None:
    """That of some bodies, each as it first rests; None where the recording begins later."""
    clock, signals = evaluator.clock, evaluator.relations.signals
    if clock.late:
        return None
    first = max((signals.baseline_of(body).start for body in env.values()), default=0)
    named = max(first_frames(evaluator.rules, clock), signals.baseline.asked)
    together = clock.together(first, named)
    last = min(evaluator.frames, first + together)
    coarse = bool(clock.coarse[first : last - 1].any())
    stop = min(last, first + max(signals.baseline.asked, SURELY if coarse else 1))
    return InitialState(first, stop, last, named - together, coarse)


def first_frames(rules: ast.RuleSet, clock: Clock) -> int:
    """How many frames ``[baseline] span`` names.

    Raises RuleError for a span that is not the first stretch of the episode.
    """
    span = rules.baseline
    if (
        isinstance(span, ast.Part)
        and span.which == "first"
        and isinstance(span.of, ast.Whole)
        and isinstance(span.duration, ast.Duration)
    ):
        if span.duration.frames:
            return max(1, round(span.duration.amount))
        return clock.window(lasting(span.duration)).stop(0)
    raise RuleError("[baseline] span", "not a first stretch.", '"first 5 frames of episode"')
