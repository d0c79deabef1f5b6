"""Checks of names, numbers, events, durations and spans in rule files."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from safestage_eval.errors import did_you_mean
from safestage_eval.evidence.declare import Signal
from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import an

from . import string_parser
from . import syntax as ast
from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Names, Near, a_dimension, dimension_of

Read = tuple[str, str]
"""Kind and name of a definition: ``("state", "moved")``."""

T = TypeVar("T")


@dataclass
class Scope:
    """One definition or rule while it is checked, and what it turned out to use.

    Attributes:
        label: how messages call it: ``state moved``, ``ETS101``.
        roles: roles or formal arguments that may be named in it.
        counting: "at least 2 role" has a meaning in it (rules and goals).
        siblings: keys of the table around, which may have slipped into a sub-table.
        used: roles that were named.
        reads: definitions that were named.
        calls: names that were applied to roles directly.
        groups: unions of bodies passed on: (callee, argument, union, where).
        passed: formal arguments passed on: (formal, callee, argument) → where.
        kinds: role → what may play it, where that is said (rules and goals).
    """

    label: str
    roles: tuple[str, ...]
    counting: bool = False
    siblings: tuple[str, ...] = ()
    used: set[str] = field(default_factory=set)
    reads: set[Read] = field(default_factory=set)
    calls: set[str] = field(default_factory=set)
    groups: list[tuple[str, int, str, Keys]] = field(default_factory=list)
    passed: dict[tuple[str, str, int], Keys] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)

    def unreadable(self) -> None:
        """Part of it cannot be read, so its use of roles is unknown."""
        self.used |= set(self.roles)


SUGGESTED = 200
"""Problems for which similar names are searched; more than are printed."""


class References:
    """Checks what one file names against all names; problems are collected, never raised."""

    def __init__(self, file: RuleFile, names: Names, problems: list[Diagnostic]) -> None:
        """``problems`` is added to."""
        self.file, self.names, self.problems = file, names, problems

    def report(
        self,
        code: str,
        keys: Keys,
        what: str,
        allowed: str = "",
        fix: str | Near = "",
        *,
        key: bool = False,
    ) -> None:
        """A problem at an entry's value, or at its key."""
        if isinstance(fix, Near):
            fix = did_you_mean(*fix) if len(self.problems) < SUGGESTED else ""
        self.problems.append(self.file.diagnostic(code, keys, what, allowed, fix, key=key))

    def parsed(
        self, code: str, keys: Keys, read: Callable[[Any], T], text: Any, *, key: bool = False
    ) -> T | None:
        """A string parsed by ``parse``; None, with a problem reported, if it is not in the grammar."""
        try:
            return read(text)
        except string_parser.GrammarError as error:
            self.report(code, keys, error.what, error.allowed, key=key)
            return None

    def call(self, call: ast.Call, keys: Keys, scope: Scope, *, key: bool = False) -> str | None:
        """``signal`` or ``state``, whatever a call names; None, and a problem, if nothing."""
        names, name = self.names, call.name
        scope.calls.add(name)
        spec = names.signal(name)
        arity: tuple[int, ...] | None
        if spec is not None:
            kind, arity, groups = "signal", spec.arities, spec.groups
            if name in names.variants:
                scope.reads.add(("signal", name))
            self._needs_of(spec, name, keys, scope, key=key)
        elif name in names.variants:  # its own definition cannot be read, and says so
            scope.reads.add(("signal", name))
            scope.unreadable()
            return None
        elif name in names.states:
            formals = names.states[name]
            kind, groups, arity = "state", True, None if formals is None else (len(formals),)
            scope.reads.add(("state", name))
        elif name in RELATIONS:
            kind, arity = "state", RELATIONS[name].arities
            groups = RELATIONS[name].groups
        elif name in names.phases:
            self.report(
                "R404", keys, f"{name} is a phase; here a signal or a state is needed", key=key
            )
            return None
        else:
            self.report(
                "R401", keys, f"there is no signal or state called {name}()",
                "built-in signals and relations, and declared states (safestage rules signals)",
                Near(name, names.callable()), key=key,
            )  # fmt: skip
            scope.unreadable()
            return None
        self.arity(call, arity, keys, key=key)
        named = 1 if spec is not None and spec.named else 0
        for index, arg in enumerate(call.args[named:], named):
            if arg not in GROUPS:
                if self.role(arg, keys, scope, key=key):
                    scope.passed.setdefault((arg, name, index), keys)
            elif not groups:
                self.report(
                    "R413", keys,
                    f"{name}() takes one body{' on either side' * (arity == (2,))}, and {arg} stands for several",
                    f"a role; these take {arg}: {_takers()}", key=key,
                )  # fmt: skip
            elif kind == "state" or name in names.derived:
                scope.groups.append((name, index, arg, keys))
        return kind

    def _needs_of(self, spec: Signal, name: str, keys: Keys, scope: Scope, *, key: bool) -> None:
        """Whether the options and material columns that a signal needs are there."""
        for option in spec.options:
            if option.required and option.name != spec.named:
                self.report(
                    "R414", keys, f'{name}() needs "{option.name}"',
                    f'[signal.NAME] with base = "{spec.name}" and {option.name} = …', key=key,
                )  # fmt: skip
            if option.param and option.name in self.names.params:
                scope.reads.add(("param", option.name))
                given = self.names.params[option.name]
                if given is not None and given != option.kind:
                    self.report(
                        "R407", keys,
                        f"{name}() reads {option.name} as {an(option.kind)}, but it is {an(given)}",
                        a_dimension(option.kind), key=key,
                    )  # fmt: skip
        for column, dimension in spec.columns:
            scope.reads.add(("column", column))
            given = self.names.columns.get(column, dimension)
            if column not in self.names.columns:
                self.report(
                    "R409", keys, f'{name}() reads the column "{column}", which no material has',
                    f"[material.default] {column} = {a_dimension(dimension)}", key=key,
                )  # fmt: skip
            elif given is not None and given != dimension:
                self.report(
                    "R407", keys,
                    f"{name}() reads {column} as {an(dimension)}, but the column is {an(given)}",
                    a_dimension(dimension), key=key,
                )  # fmt: skip

    def arity(
        self, call: ast.Call, arity: tuple[int, ...] | None, keys: Keys, *, key: bool
    ) -> None:
        """Whether a call has one of the numbers of roles that it may have."""
        if arity is not None and len(call.args) not in arity:
            takes = " or ".join(map(str, arity))
            self.report(
                "R402", keys,
                f"{call.name}() takes {takes} role{'s' if takes != '1' else ''}, not {len(call.args)}",
                key=key,
            )  # fmt: skip

    def role(self, name: str, keys: Keys, scope: Scope, *, key: bool) -> bool:
        """Whether a name is a role here; it then counts as used."""
        if name in scope.roles:
            scope.used.add(name)
            return True
        self.report(
            "R403", keys, f'"{name}" is not a role of {scope.label}',
            ", ".join([*scope.roles, *GROUPS]), Near(name, [*scope.roles, *GROUPS]), key=key,
        )  # fmt: skip
        return False

    def parameter(self, name: str, keys: Keys, scope: Scope) -> bool:
        """Whether a name is a parameter; it then counts as read."""
        scope.reads.add(("param", name))
        if name in self.names.params:
            return True
        self.report(
            "R408", keys, f'there is no parameter "{name}"',
            "a quantity with its unit, or a name declared under [param]",
            Near(name, self.names.params),
        )  # fmt: skip
        return False

    def setting(self, name: str, value: Any, keys: Keys) -> None:
        """``NAME = VALUE`` for a declared parameter."""
        if name not in self.names.params:
            self.report(
                "R408", keys, f'there is no parameter "{name}"', ", ".join(sorted(self.names.params)),
                Near(name, self.names.params), key=True,
            )  # fmt: skip
            return
        given = self.value_of(value, keys)
        wanted = self.names.params[name]
        if given is not None and wanted is not None and dimension_of(given) != wanted:
            self.report(
                "R407", keys, f"{name} is {an(wanted)}, but {literal(value)} is {an(dimension_of(given))}",
                a_dimension(wanted),
            )  # fmt: skip

    def value_of(self, value: Any, keys: Keys) -> ast.Setting | None:
        """The value of a parameter or material column."""
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            self.report("R306", keys, f"{literal(value)} is not a quantity", '"8 cm", "0.5 s", 0.5')
            return None
        return self.parsed("R306", keys, string_parser.setting, value)

    def limit_value(
        self, value: ast.Value, dimension: str, of: str, keys: Keys, scope: Scope
    ) -> None:
        """Whether a limit's value fits what it is compared with."""
        given: str | None
        if isinstance(value, ast.Quantity):
            given, said = value.dimension, f'"{value.text}"'
        elif isinstance(value, ast.Parameter):
            if not self.parameter(value.name, keys, scope):
                return
            given, said = self.names.params[value.name], value.name
        else:
            if not self.role(value.role, keys, scope, key=False):
                return
            scope.reads.add(("column", value.name))
            if value.name not in self.names.columns:
                self.report(
                    "R409", keys, f'no material has a column "{value.name}"',
                    ", ".join(sorted(self.names.columns)) or "columns declared in [material.default]",
                    Near(value.name, self.names.columns),
                )  # fmt: skip
                return
            given, said = self.names.columns[value.name], f"{value.name}({value.role})"
        if dimension == "number" and given == "ratio":  # so is a number without a unit called
            return
        if given is not None and given != dimension:
            self.report(
                "R407", keys, f"{of} is {an(dimension)}, but {said} is {an(given)}",
                a_dimension(dimension),
            )  # fmt: skip

    def budget(self, value: Any, keys: Keys, scope: Scope) -> None:
        """Check a budget: a plain number that is not negative."""
        limit = self.parsed("R301", keys, string_parser.limit, f"<= {value}")
        if limit is None:
            return
        self.limit_value(limit.value, "ratio", "a cost", keys, scope)
        if isinstance(limit.value, ast.Column):
            self.report("R301", keys, "a budget is no material's", "a number, or a parameter")
        if isinstance(limit.value, ast.Quantity) and limit.value.value < 0:
            self.report("R301", keys, "a cost is never negative", "a number from 0 on")

    def above(self, call: ast.Call, value: Any, keys: Keys, scope: Scope) -> None:
        """Check the ``above`` or ``below`` of a charge."""
        spec = self.names.signal(call.name)
        limit = self.parsed("R301", keys, string_parser.limit, f"> {value}")
        if limit is not None and spec is not None:
            self.limit_value(limit.value, spec.dimension, f"{call.name}()", keys, scope)

    # ---- time

    def event(self, text: str, keys: Keys, scope: Scope) -> None:
        """A moment, or the frames of a state."""
        parsed = self.parsed("R303", keys, string_parser.event, text)
        if parsed is None:
            scope.unreadable()
        else:
            self.moment(parsed, keys, scope)

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
        lasting = self.parsed("R302", keys, string_parser.duration, text)
        if isinstance(lasting, ast.Parameter):
            self._lasting(lasting, keys, scope)

    def option_time(self, text: str, keys: Keys, scope: Scope) -> None:
        """The time of a signal's option, if it is a parameter."""
        if re.fullmatch(string_parser.NAME, text):
            self._lasting(ast.Parameter(text), keys, scope)

    def _lasting(self, lasting: ast.Duration | ast.Parameter, keys: Keys, scope: Scope) -> None:
        if isinstance(lasting, ast.Parameter) and self.parameter(lasting.name, keys, scope):
            dimension = self.names.params[lasting.name]
            if dimension not in (None, "time"):
                self.report(
                    "R407", keys, f"a duration is needed, but {lasting.name} is {an(str(dimension))}",
                    a_dimension("time"),
                )  # fmt: skip

    def span(self, text: str, keys: Keys, scope: Scope) -> None:
        """A stretch of frames."""
        parsed = self.parsed("R304", keys, string_parser.span, text)
        if parsed is None:
            scope.unreadable()
        else:
            self._span(parsed, keys, scope)

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
        phases = self.names.phases
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


def literal(value: Any) -> str:
    """A TOML value as its author wrote it, about."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, dict):
        return "a table"
    return "a list" if isinstance(value, list) else str(value)


def _takers() -> str:
    """The signals of two bodies that take the robot as a whole, which has several."""
    return ", ".join(sorted(n for n, s in SIGNALS.items() if s.groups and s.arities == (2,)))
