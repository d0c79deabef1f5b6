"""What may stand in the tables of a rule file, read once: a node of the syntax tree, or problems.

Each reader gets what TOML gives, the place where it stands and the scope that it stands in, and returns a node; what
is wrong with it is reported, never raised. A node of a file with problems may lack parts, and is not used.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, TypeVar

from safestage_eval.errors import did_you_mean, nearest
from safestage_eval.evidence.declare import Signal
from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import an

from . import string_parser
from . import syntax as ast
from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Names, a_dimension, dimension_of

Read = tuple[str, str]
"""Kind and name of a definition: ``("state", "moved")``."""

T = TypeVar("T")


class Place(NamedTuple):
    """Where something stands: the way to its entry, and whether its key is meant.

    ``exact``: the nodes read from it count their characters from its own beginning.
    """

    keys: Keys
    key: bool = False
    exact: bool = True

    def inner(self, *more: str | int, key: bool = False) -> Place:
        """A place in the table or list that stands here."""
        return Place((*self.keys, *more), key)

    @property
    def at_key(self) -> Place:
        """The key of the same entry."""
        return self._replace(key=True)


@dataclass
class Scope:
    """One definition or rule while it is read, and what it turned out to use.

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
    roles: tuple[str, ...] = ()
    counting: bool = False
    siblings: tuple[str, ...] = ()
    used: set[str] = field(default_factory=set)
    reads: set[Read] = field(default_factory=set)
    calls: set[str] = field(default_factory=set)
    groups: list[tuple[str, int, str, Place]] = field(default_factory=list)
    passed: dict[tuple[str, str, int], Place] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)

    def unreadable(self) -> None:
        """Part of it cannot be read, so its use of roles is unknown."""
        self.used |= set(self.roles)


SUGGESTED = 200
"""Problems for which similar names are searched; more than are printed."""


class Values:
    """Reads what stands in one file, knowing all names; problems are collected."""

    def __init__(self, file: RuleFile, names: Names, problems: list[Diagnostic]) -> None:
        """``problems`` is added to."""
        self.file, self.names, self.problems = file, names, problems

    def report(
        self,
        code: str,
        here: Place,
        what: str,
        allowed: str = "",
        fix: str = "",
        *,
        near: tuple[str, Iterable[str]] | None = None,
        within: tuple[int, str] | None = None,
    ) -> None:
        """A problem at an entry; ``near``: what was written, and the names that may be meant.

        ``within``: from which character of its string on, and the word that is meant.
        """
        if near is not None and len(self.problems) < SUGGESTED:
            fix = did_you_mean(*near) or fix
        word = None if within is None or not here.exact else (within[0], len(within[1]))
        diagnostic = self.file.diagnostic(
            code, here.keys, what, allowed, fix, key=here.key, within=word
        )
        self.problems.append(diagnostic)

    def parsed(self, code: str, here: Place, read: Callable[[Any], T], text: Any) -> T | None:
        """A string that was read; None, with a problem reported, if it is not in the grammar."""
        try:
            return read(text)
        except string_parser.GrammarError as error:
            self.report(code, here, error.what, error.allowed)
            return None

    # ---- names

    def call(self, call: ast.Call, here: Place, scope: Scope) -> Literal["signal", "state"] | None:
        """``signal`` or ``state``, whatever a call names; None, and a problem, if nothing."""
        names, name = self.names, call.name
        word = (call.at[0], name) if call.at else None
        scope.calls.add(name)
        spec = names.signal(name)
        kind: Literal["signal", "state"] = "signal" if spec is not None else "state"
        arity: tuple[int, ...] | None
        if spec is not None:
            arity, groups = spec.arities, spec.groups
            if name in names.variants:
                scope.reads.add(("signal", name))
            self._needs_of(spec, name, here, scope)
        elif name in names.variants:  # its own definition cannot be read, and says so
            scope.reads.add(("signal", name))
            scope.unreadable()
            return None
        elif name in names.states:
            formals = names.states[name]
            groups, arity = True, None if formals is None else (len(formals),)
            scope.reads.add(("state", name))
        elif name in RELATIONS:
            arity, groups = RELATIONS[name].arities, RELATIONS[name].groups
        elif name in names.phases:
            what = f"{name} is a phase; here a signal or a state is needed"
            self.report("R404", here, what, within=word)
            return None
        else:
            self.report(
                "R401", here, f"there is no signal or state called {name}()",
                "built-in signals and relations, and declared states (safestage rules signals)",
                near=(name, names.callable()), within=word,
            )  # fmt: skip
            scope.unreadable()
            return None
        self._arity(call, arity, here)
        named = 1 if spec is not None and spec.named else 0
        for index, arg in enumerate(call.args[named:], named):
            if arg not in GROUPS:
                self._passed(call, index, here, scope)
            elif not groups:
                each = " on either side" * (arity == (2,))
                what = f"{name}() takes one body{each}, and {arg} stands for several"
                allowed = f"a role; these take {arg}: {_takers()}"
                self.report("R413", here, what, allowed, within=(call.at[index + 1], arg))
            elif kind == "state" or name in names.derived:
                scope.groups.append((name, index, arg, here))
        return kind

    def _needs_of(self, spec: Signal, name: str, here: Place, scope: Scope) -> None:
        """Whether the options and material columns that a signal needs are there."""
        for option in spec.options:
            if option.required and option.name != spec.named:
                fix = f'[signal.NAME] with base = "{spec.name}" and {option.name} = …'
                self.report("R414", here, f'{name}() needs "{option.name}"', fix)
            if option.param and option.name in self.names.params:
                scope.reads.add(("param", option.name))
                given = self.names.params[option.name]
                if given is not None and given != option.kind:
                    what = (
                        f"{name}() reads {option.name} as {an(option.kind)}, but it is {an(given)}"
                    )
                    self.report("R407", here, what, a_dimension(option.kind))
        for column, dimension in spec.columns:
            scope.reads.add(("column", column))
            given = self.names.columns.get(column, dimension)
            if column not in self.names.columns:
                what = f'{name}() reads the column "{column}", which no material has'
                fix = f"[material.default] {column} = {a_dimension(dimension)}"
                self.report("R409", here, what, fix)
            elif given is not None and given != dimension:
                what = f"{name}() reads {column} as {an(dimension)}, but the column is {an(given)}"
                self.report("R407", here, what, a_dimension(dimension))

    def _arity(self, call: ast.Call, arity: tuple[int, ...] | None, here: Place) -> None:
        """Whether a call has one of the numbers of roles that it may have."""
        if arity is not None and len(call.args) not in arity:
            takes = " or ".join(map(str, arity))
            roles = f"role{'s' if takes != '1' else ''}"
            self.report("R402", here, f"{call.name}() takes {takes} {roles}, not {len(call.args)}")

    def _passed(self, call: ast.Call, index: int, here: Place, scope: Scope) -> None:
        """A role that is passed on, if it is one."""
        arg = call.args[index]
        if self.role(arg, here, scope, call.at[index + 1]):
            scope.passed.setdefault((arg, call.name, index), here)

    def role(self, name: str, here: Place, scope: Scope, at: int) -> bool:
        """Whether a name is a role here; it then counts as used, and so does one that it misspells."""
        if name in scope.roles:
            scope.used.add(name)
            return True
        known = [*scope.roles, *GROUPS]
        scope.used.add(nearest(name, known))
        self.report(
            "R403", here, f'"{name}" is not a role of {scope.label}', ", ".join(known),
            near=(name, known), within=(at, name),
        )  # fmt: skip
        return False

    def parameter(self, node: ast.Parameter, here: Place, scope: Scope) -> bool:
        """Whether a name is a parameter; it then counts as read."""
        scope.reads.add(("param", node.name))
        if node.name in self.names.params:
            return True
        self.report(
            "R408", here, f'there is no parameter "{node.name}"',
            "a quantity with its unit, or a name declared under [param]",
            near=(node.name, self.names.params), within=(node.at[0], node.name) if node.at else None,
        )  # fmt: skip
        return False

    def setting(self, name: str, value: Any, here: Place) -> ast.Setting | None:
        """``NAME = VALUE`` for a declared parameter."""
        params = self.names.params
        if name not in params:
            what = f'there is no parameter "{name}"'
            self.report("R408", here.at_key, what, ", ".join(sorted(params)), near=(name, params))
            return None
        given, wanted = self.value_of(value, here), params[name]
        if given is not None and wanted is not None and dimension_of(given) != wanted:
            said = an(dimension_of(given))
            what = f"{name} is {an(wanted)}, but {literal(value)} is {said}"
            self.report("R407", here, what, a_dimension(wanted))
        return given

    def value_of(self, value: Any, here: Place) -> ast.Setting | None:
        """The value of a parameter or material column."""
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            self.report("R306", here, f"{literal(value)} is not a quantity", '"8 cm", "0.5 s", 0.5')
            return None
        return self.parsed("R306", here, string_parser.setting, value)

    def limited(self, value: ast.Value, dimension: str, of: str, here: Place, scope: Scope) -> None:
        """Whether a limit's value fits what it is compared with."""
        if isinstance(value, ast.Quantity):
            given: str | None = value.dimension
            said = f'"{value.text}"'
        elif isinstance(value, ast.Parameter):
            if not self.parameter(value, here, scope):
                return
            given, said = self.names.params[value.name], value.name
        else:
            columns = self.names.columns
            if not self.role(value.role, here, scope, value.at[1]):
                return
            scope.reads.add(("column", value.name))
            if value.name not in columns:
                self.report(
                    "R409", here, f'no material has a column "{value.name}"',
                    ", ".join(sorted(columns)) or "columns declared in [material.default]",
                    near=(value.name, columns), within=(value.at[0], value.name),
                )  # fmt: skip
                return
            given, said = columns[value.name], f"{value.name}({value.role})"
        if dimension == "number" and given == "ratio":  # so is a number without a unit called
            return
        if given is not None and given != dimension:
            what = f"{of} is {an(dimension)}, but {said} is {an(given)}"
            self.report("R407", here, what, a_dimension(dimension))

    # ---- time

    def event(self, text: str, here: Place, scope: Scope) -> ast.Event | None:
        """A moment, or the frames of a state."""
        event = self.parsed("R303", here, string_parser.event, text)
        if event is None:
            scope.unreadable()
        else:
            self.moment(event, here, scope)
        return event

    def moment(self, event: ast.Event, here: Place, scope: Scope) -> None:
        """An event that the grammar has already made out."""
        if event.call is not None:
            self._demand_state(event.call, "an event", here, scope)

    def _demand_state(self, call: ast.Call, what: str, here: Place, scope: Scope) -> None:
        if self.call(call, here, scope) == "signal":
            fix = f'declare one: [state.NAME] when = {{ "{call}" = "…" }}'
            said = f"{call.name}() is a signal; {what} needs a state"
            self.report("R404", here, said, fix=fix, within=(call.at[0], str(call.name)))

    def lasting(self, text: str, here: Place, scope: Scope) -> ast.Lasting | None:
        """A duration, or a parameter that holds one."""
        lasting = self.parsed("R302", here, string_parser.duration, text)
        self.timed(lasting, here, scope)
        return lasting

    def timed(self, lasting: ast.Lasting | None, here: Place, scope: Scope) -> None:
        """Whether a parameter holds a time, where a duration is one."""
        if isinstance(lasting, ast.Parameter) and self.parameter(lasting, here, scope):
            dimension = self.names.params[lasting.name]
            if dimension not in (None, "time"):
                what = f"a duration is needed, but {lasting.name} is {an(str(dimension))}"
                self.report("R407", here, what, a_dimension("time"))

    def span(self, text: str, here: Place, scope: Scope) -> ast.Span | None:
        """A stretch of frames."""
        span = self.parsed("R304", here, string_parser.span, text)
        if span is None:
            scope.unreadable()
            return None
        return self._span(span, here, scope)

    def _span(self, span: ast.Span, here: Place, scope: Scope) -> ast.Span:
        """The span with phases recognised."""
        match span:
            case ast.PhaseSpan(call) | ast.StateSpan(call):
                return self._named_span(call, here, scope)
            case ast.Part(_, duration, of):
                self.timed(duration, here, scope)
                return replace(span, of=self._span(of, here, scope))
            case ast.Around(_, duration, event):
                self.timed(duration, here, scope)
                self.moment(event, here, scope)
            case ast.FromTo(begin, stop):
                self.moment(begin, here, scope)
                self.moment(stop, here, scope)
            case ast.While(of, call):
                kept = self._span(of, here, scope)
                self._demand_state(call, '"while"', here, scope)
                return replace(span, of=kept)
        return span

    def _named_span(self, call: ast.Call, here: Place, scope: Scope) -> ast.Span:
        phases = self.names.phases
        if call.name in phases:
            scope.reads.add(("phase", call.name))
            formals = phases[call.name]
            self._arity(call, None if formals is None else (len(formals),), here)
            for index, arg in enumerate(call.args):
                if arg in GROUPS:
                    scope.groups.append((call.name, index, arg, here))
                else:
                    self._passed(call, index, here, scope)
            return ast.PhaseSpan(call)
        if call.args or self.names.is_state(call.name):
            self._demand_state(call, "a span", here, scope)
        else:
            spans = ["episode", *phases]
            self.report(
                "R401", here, f'there is no phase called "{call.name}"',
                f"{', '.join(spans)}, or a state with its roles",
                near=(call.name, spans), within=(call.at[0], call.name),
            )  # fmt: skip
        return ast.StateSpan(call)

    # ---- conditions

    def condition(
        self, table: Any, here: Place, scope: Scope, depth: int = 1
    ) -> ast.Condition | None:
        """A table whose entries must all hold."""
        if isinstance(table, dict) and table and depth <= 2:
            self._twice(table, here)
            atoms = [self._entry(k, v, here.inner(k), scope, depth) for k, v in table.items()]
            return ast.Condition(tuple(atom for atom in atoms if atom is not None))
        scope.unreadable()
        if not isinstance(table, dict):
            what = f"a condition is a table, not {literal(table)}"
            self.report(
                "R203", here, what, '{ "moved(target)" = true, "tilt(target)" = "<= 15 deg" }'
            )
        elif not table:
            self.report("R203", here, "an empty condition says nothing", "at least one entry")
        else:
            fix = "give the inner part a name: [state.NAME]"
            self.report("R207", here, "nested more than two levels deep", fix=fix)
        return None

    def alternative(
        self, value: Any, here: Place, scope: Scope, depth: int = 1
    ) -> ast.Alternative | None:
        """An event or state as a string, or a condition as a table."""
        if isinstance(value, str):
            return self.event(value, here, scope)
        return self.condition(value, here, scope, depth)

    def listed(
        self, items: list[Any], here: Place, scope: Scope, depth: int = 1
    ) -> tuple[Any, ...]:
        """The alternatives of a list."""
        found = [self.alternative(v, here.inner(i), scope, depth) for i, v in enumerate(items)]
        return tuple(one for one in found if one is not None)

    def _twice(self, table: dict[str, Any], here: Place) -> None:
        """TOML refuses a key that stands twice, but not one that is only spaced differently."""
        seen: dict[str, str] = {}
        for key in table:
            first = seen.setdefault(re.sub(r"\s+", "", key), key)
            if first != key:
                what = f'"{first}" and "{key}" are one entry, written twice'
                fix = "leave one out; several limits on one signal are a list"
                self.report("R211", here.inner(key, key=True), what, fix=fix)

    def _entry(
        self, key: str, value: Any, here: Place, scope: Scope, depth: int
    ) -> ast.Atom | None:
        at_key = here.at_key
        if key == "any":
            if isinstance(value, list) and value:
                return ast.AnyOf(self.listed(value, here, scope, depth + 1))
            self.report("R203", here, '"any" takes a list of alternatives', '["a(x)", { … }]')
            return None
        if key in scope.siblings:
            what = f'"{key}" is a key of {scope.label}, but stands inside a condition'
            fix = f'write "{key} = …" before the sub-table that swallowed it'
            self.report("R204", at_key, what, fix=fix)
            return None
        atom = self.parsed("R307", at_key, string_parser.atom, key)
        if atom is None:
            scope.unreadable()
            return None
        if atom.since is not None:
            self.moment(atom.since, at_key, scope)
        kind = self.call(atom.call, at_key, scope)
        if kind == "signal":
            return self._limits(atom, value, here, scope)
        return self._truth(atom, value, here, scope) if kind == "state" else None

    def _limits(
        self, atom: ast.SignalAtom, value: Any, here: Place, scope: Scope
    ) -> ast.SignalAtom | None:
        call = atom.call
        spec = self.names.signal(call.name)
        if spec is None:
            return None
        if atom.since is not None:
            self.since(call, here.at_key)
        limits = []
        for index, item in enumerate(value if isinstance(value, list) else [value]):
            at = here.inner(index) if isinstance(value, list) else here
            if not isinstance(item, str) or item.startswith("at "):
                what = f"{call.name}() is a signal: it needs a limit, not {literal(item)}"
                fix = f'">= …" with {a_dimension(spec.dimension)}, or a list of limits'
                self.report("R405", at, what, fix)
                continue
            limit = self.parsed("R301", at, string_parser.limit, item)
            if limit is not None:
                self.limited(limit.value, spec.dimension, f"{call.name}()", at, scope)
                limits.append(limit)
        return replace(atom, limits=tuple(limits))

    def since(self, call: ast.Call, here: Place) -> None:
        """Whether a signal can be taken since an event."""
        spec = self.names.signal(call.name)
        if spec is not None and not spec.since:
            what = f'{call.name}() has no reference, so it cannot be taken "since"'
            others = ", ".join(one.name for one in SIGNALS.values() if one.since)
            self.report("R406", here, what, f"signals with a reference: {others}")

    def _truth(
        self, atom: ast.SignalAtom, value: Any, here: Place, scope: Scope
    ) -> ast.StateAtom | ast.CountAtom | None:
        call = atom.call
        if atom.since is not None:
            what = f"{call.name}() is a state: only signals are taken since"
            self.report("R406", here.at_key, what)
        if isinstance(value, bool):
            return ast.StateAtom(call, value)
        try:
            counted = string_parser.count(value) if isinstance(value, str) else None
        except string_parser.GrammarError as problem:
            self.report("R301", here, problem.what, problem.allowed)
            return None
        if counted is None:
            what = f"{call.name}() is a state, not a signal: {literal(value)} does not fit"
            self.report("R405", here, what, 'true, false, "at least 2 role", "at most 1 role"')
        elif not scope.counting:
            what = "bodies can be counted in rules and goals only, where roles are"
            self.report("R405", here, what, "true, false")
        elif counted[2] not in call.args:
            what = f'"{counted[2]}" is not an argument of {call}'
            allowed = ", ".join(call.args)
            self.report("R403", here, what, allowed, near=(counted[2], call.args))
        return None if counted is None else ast.CountAtom(call, *counted)

    # ---- operands of computed signals

    def state_operand(self, value: Any, here: Place, scope: Scope) -> ast.StateAtom | None:
        """A state; what is wrong with it is reported."""
        call = self.parsed("R307", here, string_parser.call, str(value))
        if call is None:
            scope.unreadable()
            return None
        kind = self.call(call, here, scope)
        if kind == "signal":
            self.report("R404", here, f"{call.name}() is a signal", "a state or relation")
        return ast.StateAtom(call, True) if kind == "state" else None

    def operand(self, value: Any, here: Place, scope: Scope) -> ast.Operand | None:
        """A signal, a quantity or a parameter; what is wrong with it is reported."""
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            self.report("R416", here, "this is no operand", '"speed(a)", "2 cm", 0.5, a parameter')
            return None
        operand = self.parsed("R416", here, string_parser.operand, value)
        if operand is None:
            scope.unreadable()
        if isinstance(operand, ast.Parameter):
            self.parameter(operand, here, scope)
        if isinstance(operand, ast.SignalAtom):
            if operand.since is not None:
                self.moment(operand.since, here, scope)
            kind = self.call(operand.call, here, scope)
            if kind == "state":
                self.report("R404", here, f"{operand.call.name}() is a state", "a signal")
            elif kind == "signal" and operand.since is not None:
                self.since(operand.call, here)
        return operand


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
