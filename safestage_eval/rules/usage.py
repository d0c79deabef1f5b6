"""Whether what a condition, a span or an event says makes sense: grammar, names, dimensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.signals.vocabulary import SIGNALS

from . import parse
from . import syntax as ast
from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Names, a_dimension, dimension_of, nearest

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
        passed: formal arguments passed on: (formal, callee, argument).
    """

    label: str
    roles: tuple[str, ...]
    counting: bool = False
    siblings: tuple[str, ...] = ()
    used: set[str] = field(default_factory=set)
    reads: set[Read] = field(default_factory=set)
    calls: set[str] = field(default_factory=set)
    groups: list[tuple[str, int, str, Keys]] = field(default_factory=list)
    passed: set[tuple[str, str, int]] = field(default_factory=set)

    def unreadable(self) -> None:
        """Part of it cannot be read, so whether its roles are used cannot be told."""
        self.used |= set(self.roles)


class Usage:
    """Checks one file's strings against all names; problems are collected, never raised."""

    def __init__(self, file: RuleFile, names: Names, problems: list[Diagnostic]) -> None:
        """``problems`` is added to."""
        self.file, self.names, self.problems = file, names, problems

    def report(
        self,
        code: str,
        keys: Keys,
        what: str,
        allowed: str = "",
        fix: str = "",
        *,
        key: bool = False,
    ) -> None:
        """A problem at an entry's value, or at its key."""
        self.problems.append(self.file.diagnostic(code, keys, what, allowed, fix, key=key))

    def parsed(
        self, code: str, keys: Keys, read: Callable[[Any], T], text: Any, *, key: bool = False
    ) -> T | None:
        """What the grammar makes of a string; None, and a problem, if nothing."""
        try:
            return read(text)
        except parse.GrammarError as error:
            self.report(code, keys, error.what, error.allowed, key=key)
            return None

    # ---- conditions

    def condition(self, table: Any, keys: Keys, scope: Scope, depth: int = 1) -> None:
        """A table of which every entry must hold."""
        if not isinstance(table, dict) or not table or depth > 2:
            scope.unreadable()
        if not isinstance(table, dict):
            self.report(
                "R203", keys, f"a condition is a table, not {_literal(table)}",
                '{ "moved(target)" = true, "tilt(target)" = "<= 15 deg" }',
            )  # fmt: skip
        elif not table:
            self.report("R203", keys, "an empty condition says nothing", "at least one entry")
        elif depth > 2:
            self.report(
                "R207", keys, "nested more than two levels deep",
                fix="give the inner part a name: [state.NAME]",
            )  # fmt: skip
        else:
            for key, value in table.items():
                self._entry(key, value, (*keys, key), scope, depth)

    def alternative(self, value: Any, keys: Keys, scope: Scope, depth: int = 1) -> None:
        """An event or state as a string, or a condition as a table."""
        if isinstance(value, str):
            self.event(value, keys, scope)
        else:
            self.condition(value, keys, scope, depth)

    def _entry(self, key: str, value: Any, keys: Keys, scope: Scope, depth: int) -> None:
        if key == "any":
            if not isinstance(value, list) or not value:
                self.report("R203", keys, '"any" takes a list of alternatives', '["a(x)", { … }]')
                return
            for index, item in enumerate(value):
                self.alternative(item, (*keys, index), scope, depth + 1)
            return
        if key in scope.siblings:
            self.report(
                "R204", keys, f'"{key}" is a key of {scope.label}, but stands inside a condition',
                fix=f'write "{key} = …" before the sub-table that swallowed it', key=True,
            )  # fmt: skip
            return
        atom = self.parsed("R307", keys, parse.atom_key, key, key=True)
        if atom is None:
            scope.unreadable()
            return
        call, since = atom
        if since is not None:
            self._event(since, keys, scope, key=True)
        known = self.call(call, keys, scope, key=True)
        if known == "signal":
            self._limits(call, since, value, keys, scope)
        elif known == "state":
            self._truth(call, since, value, keys, scope)

    def _limits(
        self, call: ast.Call, since: ast.Event | None, value: Any, keys: Keys, scope: Scope
    ) -> None:
        spec = self.names.signal(call.name)
        if spec is None:
            return
        if since is not None and not spec.since:
            self.report(
                "R406", keys, f'{call.name}() has no reference, so it cannot be taken "since"',
                "signals with a reference: "
                + ", ".join(known.name for known in SIGNALS.values() if known.since), key=True,
            )  # fmt: skip
        limits = value if isinstance(value, list) else [value]
        for index, item in enumerate(limits):
            at = (*keys, index) if isinstance(value, list) else keys
            if not isinstance(item, str) or item.startswith("at "):
                self.report(
                    "R405", at, f"{call.name}() is a signal: it needs a limit, not {_literal(item)}",
                    f'">= …" with {a_dimension(spec.dimension)}, or a list of limits',
                )  # fmt: skip
                continue
            limit = self.parsed("R301", at, parse.limit, item)
            if limit is not None:
                self._value(limit.value, spec.dimension, f"{call.name}()", at, scope)

    def _truth(
        self, call: ast.Call, since: ast.Event | None, value: Any, keys: Keys, scope: Scope
    ) -> None:
        allowed = 'true, false, "at least 2 role", "at most 1 role"'
        if since is not None:
            self.report(
                "R406", keys, f"{call.name}() is a state: only signals are taken since", key=True
            )
        if isinstance(value, bool):
            return
        counted = parse.count(value) if isinstance(value, str) else None
        if counted is None:
            self.report(
                "R405", keys, f"{call.name}() is a state, not a signal: {_literal(value)} does not fit",
                allowed,
            )  # fmt: skip
        elif not scope.counting:
            self.report(
                "R405",
                keys,
                "bodies can be counted in rules and goals only, where roles are",
                "true, false",
            )
        elif counted[2] not in call.args:
            self.report(
                "R403", keys, f'"{counted[2]}" is not an argument of {call}', ", ".join(call.args),
                nearest(counted[2], call.args),
            )  # fmt: skip

    def _value(self, value: ast.Value, dimension: str, of: str, keys: Keys, scope: Scope) -> None:
        given: str | None
        if isinstance(value, ast.Quantity):
            given, said = value.dimension, f'"{value.text}"'
        elif isinstance(value, ast.Parameter):
            if not self._parameter(value.name, keys, scope):
                return
            given, said = self.names.params[value.name], value.name
        else:
            if not self._role(value.role, keys, scope, key=False):
                return
            scope.reads.add(("column", value.name))
            if value.name not in self.names.columns:
                self.report(
                    "R409", keys, f'no material has a column "{value.name}"',
                    ", ".join(sorted(self.names.columns)) or "columns declared in [material.default]",
                    nearest(value.name, self.names.columns),
                )  # fmt: skip
                return
            given, said = self.names.columns[value.name], f"{value.name}({value.role})"
        if given is not None and given != dimension:
            self.report(
                "R407", keys, f"{of} is {_a(dimension)}, but {said} is {_a(given)}",
                a_dimension(dimension),
            )  # fmt: skip

    def above(self, call: ast.Call, value: Any, keys: Keys, scope: Scope) -> None:
        """What a charged signal is compared with."""
        spec = self.names.signal(call.name)
        limit = self.parsed("R301", keys, parse.limit, f"> {value}")
        if limit is not None and spec is not None:
            self._value(limit.value, spec.dimension, f"{call.name}()", keys, scope)

    # ---- names

    def call(self, call: ast.Call, keys: Keys, scope: Scope, *, key: bool = False) -> str | None:
        """``signal`` or ``state``, whatever a call names; None, and a problem, if nothing."""
        names, name = self.names, call.name
        scope.calls.add(name)
        spec = names.signal(name)
        arity: tuple[int, ...] | None
        if spec is not None:
            known, arity, groups = "signal", spec.args, spec.groups
            if name in names.variants:
                scope.reads.add(("signal", name))
        elif name in names.states:
            formals = names.states[name]
            known, groups, arity = "state", True, None if formals is None else (len(formals),)
            scope.reads.add(("state", name))
        elif name in RELATIONS:
            known, arity = "state", (RELATIONS[name].args,)
            groups = RELATIONS[name].groups
        elif name in names.phases:
            self.report(
                "R404", keys, f"{name} is a phase; here a signal or a state is needed", key=key
            )
            return None
        else:
            self.report(
                "R401", keys, f"there is no signal or state called {name}()",
                "built-in signals and relations, and declared states (docs/meanings.md)",
                nearest(name, names.callable()), key=key,
            )  # fmt: skip
            scope.unreadable()
            return None
        self._arity(call, arity, keys, key=key)
        for index, arg in enumerate(call.args):
            if arg not in GROUPS:
                if self._role(arg, keys, scope, key=key):
                    scope.passed.add((arg, name, index))
            elif not groups:
                self.report(
                    "R413", keys, f"{name}() is about one body, and {arg} stands for several",
                    "a role", key=key,
                )  # fmt: skip
            elif known == "state":
                scope.groups.append((name, index, arg, keys))
        return known

    def _arity(
        self, call: ast.Call, arity: tuple[int, ...] | None, keys: Keys, *, key: bool
    ) -> None:
        if arity is not None and len(call.args) not in arity:
            takes = " or ".join(map(str, arity))
            self.report(
                "R402", keys,
                f"{call.name}() takes {takes} role{'s' if takes != '1' else ''}, not {len(call.args)}",
                key=key,
            )  # fmt: skip

    def _role(self, name: str, keys: Keys, scope: Scope, *, key: bool) -> bool:
        if name in scope.roles:
            scope.used.add(name)
            return True
        self.report(
            "R403", keys, f'"{name}" is not a role of {scope.label}',
            ", ".join([*scope.roles, *GROUPS]), nearest(name, [*scope.roles, *GROUPS]), key=key,
        )  # fmt: skip
        return False

    def _parameter(self, name: str, keys: Keys, scope: Scope | None) -> bool:
        if scope is not None:
            scope.reads.add(("param", name))
        if name in self.names.params:
            return True
        self.report(
            "R408", keys, f'there is no parameter "{name}"',
            "a quantity with its unit, or a name declared under [param]",
            nearest(name, self.names.params),
        )  # fmt: skip
        return False

    def setting(self, name: str, value: Any, keys: Keys) -> None:
        """``NAME = VALUE`` for a declared parameter."""
        if name not in self.names.params:
            self.report(
                "R408", keys, f'there is no parameter "{name}"', ", ".join(sorted(self.names.params)),
                nearest(name, self.names.params), key=True,
            )  # fmt: skip
            return
        found = self.value_of(value, keys)
        wanted = self.names.params[name]
        if found is not None and wanted is not None and dimension_of(found) != wanted:
            self.report(
                "R407", keys, f"{name} is {_a(wanted)}, but {_literal(value)} is {_a(dimension_of(found))}",
                a_dimension(wanted),
            )  # fmt: skip

    def value_of(self, value: Any, keys: Keys) -> ast.Quantity | ast.Duration | None:
        """The value of a parameter or material column."""
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            self.report(
                "R306", keys, f"{_literal(value)} is not a quantity", '"8 cm", "0.5 s", 0.5'
            )
            return None
        return self.parsed("R306", keys, parse.setting, value)

    # ---- time

    def event(self, text: str, keys: Keys, scope: Scope) -> None:
        """A moment, or the frames of a state."""
        found = self.parsed("R303", keys, parse.event, text)
        if found is None:
            scope.unreadable()
        else:
            self._event(found, keys, scope)

    def _event(self, event: ast.Event, keys: Keys, scope: Scope, *, key: bool = False) -> None:
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

    def _lasting(self, found: ast.Duration | ast.Parameter, keys: Keys, scope: Scope) -> None:
        if isinstance(found, ast.Parameter) and self._parameter(found.name, keys, scope):
            dimension = self.names.params[found.name]
            if dimension not in (None, "time"):
                self.report(
                    "R407", keys, f"a duration is needed, but {found.name} is {_a(str(dimension))}",
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
                self._event(event, keys, scope)
            case ast.FromTo(begin, stop):
                self._event(begin, keys, scope)
                self._event(stop, keys, scope)
            case ast.While(of, call):
                self._span(of, keys, scope)
                self._state(call, '"while"', keys, scope)

    def _named_span(self, call: ast.Call, keys: Keys, scope: Scope) -> None:
        phases: Mapping[str, tuple[str, ...] | None] = self.names.phases
        if call.name in phases:
            scope.reads.add(("phase", call.name))
            formals = phases[call.name]
            self._arity(call, None if formals is None else (len(formals),), keys, key=False)
            for index, arg in enumerate(call.args):
                if arg in GROUPS:
                    scope.groups.append((call.name, index, arg, keys))
                elif self._role(arg, keys, scope, key=False):
                    scope.passed.add((arg, call.name, index))
        elif call.args or self.names.is_state(call.name):
            self._state(call, "a span", keys, scope)
        else:
            self.report(
                "R401", keys, f'there is no phase called "{call.name}"',
                f"episode, {', '.join(phases)}, or a state with its roles",
                nearest(call.name, ["episode", *phases]),
            )  # fmt: skip


def _literal(value: Any) -> str:
    """A TOML value as its author wrote it, about."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, dict):
        return "a table"
    return "a list" if isinstance(value, list) else str(value)


def _a(dimension: str) -> str:
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension}"
