"""How much of the future a rule must have seen before it can be violated: from its text alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple, cast

from safestage_eval.relations.effect import SIGNALS as EFFECTS
from safestage_eval.rules import syntax as ast
from safestage_eval.signals.options import EFFECT_OVER

Params = Mapping[str, ast.Quantity | ast.Duration]

BY_MOTION = ("held", "carried")
"""Relations that, without contact forces, are told by the whole of a motion, its end included."""


class Foresight(NamedTuple):
    """What has to be recorded after a violation before it is certain.

    Attributes:
        seconds: at most so much; ∞ for a rule that is not causal.
        awaits: what the rule waits for, if it is not causal.
    """

    seconds: float = 0.0
    awaits: str = ""

    @property
    def causal(self) -> bool:
        """The past tells, a bounded time later."""
        return not self.awaits

    def then(self, seconds: float) -> Foresight:
        """So much later still."""
        return Foresight(self.seconds + seconds, self.awaits)


NOW = Foresight()


def _all(parts: Iterable[Foresight]) -> Foresight:
    """What is known once all its parts are."""
    return max(parts, key=lambda part: part.seconds, default=NOW)


def _awaits(what: str) -> Foresight:
    return Foresight(math.inf, what)


def foresight(
    rules: ast.RuleSet, rule: ast.Scoped, params: Params, frame_dt: float, *, blind: bool = False
) -> Foresight:
    """How far a rule looks ahead.

    A limit on a signal is known at its frame. A state that must last is known once it has lasted; a
    gap once it may not be closed any more. ``reach`` is broken only when its span is over, the last
    part of a span is known only then, and what lies before an event only when that has come.

    Args:
        rules: where the states and phases that the rule names are declared.
        rule: a rule or a cost.
        params: values of the parameters, as they hold for the rule.
        frame_dt: s between recorded frames.
        blind: the trace has no contact forces.
    """
    return _Look(rules, params, frame_dt, blind=blind).rule(rule)


class _Look:
    def __init__(self, rules: ast.RuleSet, params: Params, frame_dt: float, *, blind: bool) -> None:
        self._rules, self._params, self._dt, self._blind = rules, params, frame_dt, blind
        self._states: dict[str, Foresight] = {}

    def rule(self, rule: ast.Scoped) -> Foresight:
        parts = [NOW if rule.given is None else self._condition(rule.given)]
        if rule.at is not None:
            parts.append(self._event(rule.at))
        parts.append(self._span(rule.during or ast.Whole()))
        if rule.until is not None:
            parts.append(self._event(rule.until))
        if isinstance(rule, ast.Cost):
            charged = (charge.when for charge in rule.charge if charge.when is not None)
            return _all([*parts, *map(self._alternative, charged)])
        if rule.require is not None:
            parts.append(self._condition(rule.require))
        if rule.forbidden is not None:
            lasting = NOW if rule.for_ is None else NOW.then(self._seconds(rule.for_))
            parts.append(self._alternative(rule.forbidden).then(lasting.seconds))
        if rule.reach is not None:
            span = "the episode" if rule.during is None else "the span in which it must be reached"
            parts.append(_awaits(f"the end of {span}"))
        return _all(parts)

    def _span(self, span: ast.Span) -> Foresight:
        match span:
            case ast.Whole():
                return NOW
            case ast.PhaseSpan(call):
                phase = self._rules.phases[call.name]
                instead = NOW if phase.fallback is None else self._span(phase.fallback)
                return _all([self._span(phase.span), instead])
            case ast.StateSpan(call):
                return self._state(call)
            case ast.Part("last", _, of):
                inner = self._span(of)
                return inner if inner.awaits else _awaits(f"the end of {self._named(of)}")
            case ast.Part(_, _, of):
                return self._span(of)
            case ast.Around("before", _, event):
                return _awaits(f"the event {event.text or event.kind!r} that it looks back from")
            case ast.Around(_, _, event):
                return self._event(event)
            case ast.FromTo(begin, stop):
                return _all([self._event(begin), NOW if stop.kind == "end" else self._event(stop)])
            case ast.While(of, call):
                return _all([self._span(of), self._state(call)])

    def _named(self, span: ast.Span) -> str:
        if isinstance(span, ast.PhaseSpan):
            return f"the phase {span.call.name}"
        return "the episode" if isinstance(span, ast.Whole) else "the span of which it is the last"

    def _event(self, event: ast.Event) -> Foresight:
        if event.kind == "end":
            return _awaits("the end of the episode")
        return NOW if event.call is None else self._state(event.call)

    def _alternative(self, what: ast.Alternative) -> Foresight:
        return self._condition(what) if isinstance(what, ast.Condition) else self._event(what)

    def _condition(self, condition: ast.Condition) -> Foresight:
        return _all(map(self._atom, condition.atoms))

    def _atom(self, atom: ast.Atom) -> Foresight:
        if isinstance(atom, ast.SignalAtom):
            if self._blind and atom.call.name == "fall":
                return _awaits("the end of the motion that tells held()")
            variant = self._rules.signals.get(atom.call.name)
            base = atom.call.name if variant is None else variant.base
            if base in EFFECTS:
                over = dict(variant.options).get("over") if variant is not None else EFFECT_OVER
                ahead = over if isinstance(over, ast.Parameter) else ast.Duration(cast(float, over))
                return NOW.then(self._seconds(ahead))
            return NOW if atom.since is None else self._event(atom.since)
        if isinstance(atom, ast.AnyOf):
            return _all(map(self._alternative, atom.alternatives))
        return self._state(atom.call)

    def _state(self, call: ast.Call) -> Foresight:
        state = self._rules.states.get(call.name)
        if state is None:
            if self._blind and call.name in BY_MOTION:
                return _awaits(f"the end of the motion that tells {call.name}()")
            return NOW
        if call.name not in self._states:
            self._states[call.name] = NOW  # declarations never lead back to themselves
            parts = [self._condition(state.when)]
            if self._blind:
                instead = (state.fallback, state.perhaps)
                parts += [self._condition(one) for one in instead if one is not None]
            lasting = sum(self._seconds(d) for d in (state.for_, state.gap) if d is not None)
            if state.also is not None:
                parts.append(self._condition(state.also))
            found = _all(parts).then(lasting)
            if state.until is not None and state.until.kind != "end":
                found = _all([found, self._event(state.until)])
            self._states[call.name] = found
        return self._states[call.name]

    def _seconds(self, duration: ast.Duration | ast.Parameter) -> float:
        """At least as long as the frames that a duration comes to."""
        value = self._params[duration.name] if isinstance(duration, ast.Parameter) else duration
        if isinstance(value, ast.Quantity):
            return value.value + self._dt
        if value.frames:
            return value.amount * self._dt
        return max(value.amount + self._dt, value.least * self._dt)
