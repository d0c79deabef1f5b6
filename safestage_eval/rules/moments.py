"""Whether what a rule file says about time makes sense: events, durations, spans."""

from __future__ import annotations

import re
from collections.abc import Mapping

from safestage_eval.relations.vocabulary import GROUPS

from . import parse
from . import syntax as ast
from .locate import Keys
from .names import Near, a_dimension
from .references import References, Scope, an


class Moments(References):
    """Checks events, durations and spans."""

    def event(self, text: str, keys: Keys, scope: Scope) -> None:
        """A moment, or the frames of a state."""
        found = self.parsed("R303", keys, parse.event, text)
        if found is None:
            scope.unreadable()
        else:
            self.moment(found, keys, scope)

    def moment(self, event: ast.Event, keys: Keys, scope: Scope, *, key: bool = False) -> None:
        """An event that the grammar has already made out."""
        if event.call is not None:
            self._state(event.call, "an event", keys, scope, key=key)

    def _state(
        self, call: ast.Call, what: str, keys: Keys, scope: Scope, *, key: bool = False
    ) -> None:
        if self.call(call, keys, scope, key=key) == "signal":
            self.report(
                "R404", keys, f"{call.name}() is a signal; {what} needs a state",
                fix=f"declare one: [state.NAME] when = {{ \"{call}\" = \"…\" }}", key=key,
            )  # fmt: skip

    def lasting(self, text: str, keys: Keys, scope: Scope) -> None:
        """A duration, or a parameter that holds one."""
        found = self.parsed("R302", keys, parse.duration, text)
        if isinstance(found, ast.Parameter):
            self._lasting(found, keys, scope)

    def option_time(self, text: str, keys: Keys, scope: Scope) -> None:
        """The time of a signal's option, if it is a parameter."""
        if re.fullmatch(parse.NAME, text):
            self._lasting(ast.Parameter(text), keys, scope)

    def _lasting(self, found: ast.Duration | ast.Parameter, keys: Keys, scope: Scope) -> None:
        if isinstance(found, ast.Parameter) and self.parameter(found.name, keys, scope):
            dimension = self.names.params[found.name]
            if dimension not in (None, "time"):
                self.report(
                    "R407", keys, f"a duration is needed, but {found.name} is {an(str(dimension))}",
                    a_dimension("time"),
                )  # fmt: skip

    def span(self, text: str, keys: Keys, scope: Scope) -> None:
        """A stretch of frames."""
        found = self.parsed("R304", keys, parse.span, text)
        if found is None:
            scope.unreadable()
        else:
            self._span(found, keys, scope)

    def _span(self, span: ast.Span, keys: Keys, scope: Scope) -> None:
        match span:
            case ast.PhaseSpan(call) | ast.StateSpan(call):
                self._named_span(call, keys, scope)
            case ast.Part(_, duration, of):
                self._lasting(duration, keys, scope)
                self._span(of, keys, scope)
            case ast.Around(_, duration, event):
                self._lasting(duration, keys, scope)
                self.moment(event, keys, scope)
            case ast.FromTo(begin, stop):
                self.moment(begin, keys, scope)
                self.moment(stop, keys, scope)
            case ast.While(of, call):
                self._span(of, keys, scope)
                self._state(call, '"while"', keys, scope)

    def _named_span(self, call: ast.Call, keys: Keys, scope: Scope) -> None:
        phases: Mapping[str, tuple[str, ...] | None] = self.names.phases
        if call.name in phases:
            scope.reads.add(("phase", call.name))
            formals = phases[call.name]
            self.arity(call, None if formals is None else (len(formals),), keys, key=False)
            for index, arg in enumerate(call.args):
                if arg in GROUPS:
                    scope.groups.append((call.name, index, arg, keys))
                elif self.role(arg, keys, scope, key=False):
                    scope.passed.setdefault((arg, call.name, index), keys)
        elif call.args or self.names.is_state(call.name):
            self._state(call, "a span", keys, scope)
        else:
            self.report(
                "R401", keys, f'there is no phase called "{call.name}"',
                f"{', '.join(['episode', *phases])}, or a state with its roles",
                Near(call.name, ["episode", *phases]),
            )  # fmt: skip
