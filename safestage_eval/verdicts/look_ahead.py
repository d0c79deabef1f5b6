"""How much of the future must be recorded before something in a rule is certain: from its text alone."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple, cast

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import syntax as ast
from safestage_eval.signals import SIGNALS


class Foresight(NamedTuple):
    """How much must be recorded after a violation before it is certain.

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


def latest(parts: Iterable[Foresight]) -> Foresight:
    """The foresight of what is known once all its parts are."""
    return max(parts, key=lambda part: part.seconds, default=NOW)


def awaiting(what: str) -> Foresight:
    """The foresight of a rule that is not causal."""
    return Foresight(math.inf, what)


class Look:
    """Walks through the parts of a rule.

    A limit on a signal is known at its frame. A state that must last is known once it has lasted; a
    gap once it may not be closed any more. The last part of a span is known only when the span is
    over, and what lies before an event only when that has come.
    """

    def __init__(
        self, rules: ast.RuleSet, params: ast.Params, frame_dt: float, *, blind: bool = False
    ) -> None:
        """For rules of a set.

        Args:
            rules: where the states and phases that the rule names are declared.
            params: values of the parameters, as they hold for the rule.
            frame_dt: s between recorded frames.
            blind: the trace has no contact forces.
        """
        self._rules, self._params, self._dt, self._blind = rules, params, frame_dt, blind
        self._states: dict[str, Foresight] = {}

    def scope(self, rule: ast.Scoped) -> Foresight:
        """Where a rule is judged, and whether it applies."""
        parts = [NOW if rule.given is None else self._condition(rule.given)]
        if rule.at is not None:
            parts.append(self._event(rule.at))
        parts.append(self._span(rule.during or ast.Whole()))
        if rule.until is not None:
            parts.append(self._event(rule.until))
        return latest(parts)

    def _span(self, span: ast.Span) -> Foresight:
        match span:
            case ast.Whole():
                return NOW
            case ast.PhaseSpan(call):
                phase = self._rules.phases[call.name]
                instead = NOW if phase.fallback is None else self._span(phase.fallback)
                return latest([self._span(phase.span), instead])
            case ast.StateSpan(call):
                return self._state(call)
            case ast.Part("last", _, of):
                inner = self._span(of)
                return inner if inner.awaits else awaiting(f"the end of {self._named(of)}")
            case ast.Part(_, _, of):
                return self._span(of)
            case ast.Around("before", _, event):
                return awaiting(f"the event {event.text or event.kind!r} that it looks back from")
            case ast.Around(_, _, event):
                return self._event(event)
            case ast.FromTo(begin, stop):
                return latest(
                    [self._event(begin), NOW if stop.kind == "end" else self._event(stop)]
                )
            case ast.While(of, call):
                return latest([self._span(of), self._state(call)])

    def _named(self, span: ast.Span) -> str:
        if isinstance(span, ast.PhaseSpan):
            return f"the phase {span.call.name}"
        return "the episode" if isinstance(span, ast.Whole) else "the span of which it is the last"

    def _event(self, event: ast.Event) -> Foresight:
        if event.kind == "end":
            return awaiting("the end of the episode")
        return NOW if event.call is None else self._state(event.call)

    def alternative(self, what: ast.Alternative) -> Foresight:
        """A condition or an event."""
        return self._condition(what) if isinstance(what, ast.Condition) else self._event(what)

    def _condition(self, condition: ast.Condition) -> Foresight:
        return latest(map(self._atom, condition.atoms))

    def _atom(self, atom: ast.Atom) -> Foresight:
        if isinstance(atom, ast.SignalAtom):
            computed = self._rules.derived.get(atom.call.name)
            if computed is not None:
                foresight = self._computed(computed)
                return (
                    foresight
                    if atom.since is None
                    else latest([foresight, self._event(atom.since)])
                )
            variant = self._rules.signals.get(atom.call.name)
            signal = SIGNALS[atom.call.name if variant is None else variant.base]
            if self._blind and signal.by_motion:
                return awaiting("the end of the motion that tells held()")
            ahead = signal.looks_ahead()
            if ahead is not None:
                given = {} if variant is None else dict(variant.options)
                over = given.get(ahead.name, ahead.default)
                later = over if isinstance(over, ast.Parameter) else ast.Duration(cast(float, over))
                return NOW.then(self.seconds(later))
            return NOW if atom.since is None else self._event(atom.since)
        if isinstance(atom, ast.AnyOf):
            return latest(map(self.alternative, atom.alternatives))
        other = getattr(atom, "begun", None) or getattr(atom, "other", None)
        if other is not None:
            return latest([self._state(atom.call), self._state(other)])
        return self._state(atom.call)

    def _computed(self, computed: ast.DerivedDef) -> Foresight:
        """The first derivative is that of the second sample; others look half their time ahead."""
        atoms = (ast.SignalAtom, ast.StateAtom)
        parts = [self._atom(one) for one in computed.operands if isinstance(one, atoms)]
        over = 0.0 if computed.over is None else self.seconds(computed.over) / 2
        usual = self._dt if computed.operation == "derivative" else 0.0
        return latest(parts).then(max(over, usual))

    def _state(self, call: ast.Call) -> Foresight:
        state = self._rules.states.get(call.name)
        if state is None:
            if self._blind and RELATIONS[call.name].by_motion:
                return awaiting(f"the end of the motion that tells {call.name}()")
            return NOW
        if call.name not in self._states:
            self._states[call.name] = NOW  # declarations never lead back to themselves
            parts = [self._condition(state.when)]
            if self._blind:
                instead = (state.fallback, state.perhaps)
                parts += [self._condition(one) for one in instead if one is not None]
            lasting = sum(self.seconds(d) for d in (state.for_, state.gap) if d is not None)
            if state.also is not None:
                parts.append(self._condition(state.also))
            foresight = latest(parts).then(lasting)
            if state.until is not None and state.until.kind != "end":
                foresight = latest([foresight, self._event(state.until)])
            self._states[call.name] = foresight
        return self._states[call.name]

    def seconds(self, duration: ast.Duration | ast.Parameter) -> float:
        """At least as long as the frames that a duration comes to."""
        value = self._params[duration.name] if isinstance(duration, ast.Parameter) else duration
        if isinstance(value, ast.Quantity):
            return value.value + self._dt
        if value.frames:
            return value.amount * self._dt
        return max(value.amount + self._dt, value.least * self._dt)
