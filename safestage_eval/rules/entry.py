"""One key or value of a rule file, which reads itself into a node of the syntax tree.

An ``Entry`` knows what TOML gives for it, where it stands and in which definition. What is wrong is reported, never
raised; a node of a file with problems may lack parts, and is not used.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

from safestage_eval.errors import did_you_mean, nearest
from safestage_eval.evidence.declare import Signal
from safestage_eval.relations.vocabulary import GROUPS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import an

from . import string_parser
from . import syntax as ast
from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Callee, Names, a_dimension, dimension_of

Read = tuple[str, str]
"""Kind and name of a definition: ``("state", "moved")``."""

Word = tuple[int, str] | None
"""From which character of its string on, and the word that is meant."""

T = TypeVar("T")

SUGGESTED = 200
"""Problems for which similar names are searched; more than are printed."""


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
        passed: what was passed on: (role or union of bodies, callee, argument) → where.
        kinds: role → what may play it, where that is said (rules and goals).
    """

    label: str = ""
    roles: tuple[str, ...] = ()
    counting: bool = False
    siblings: tuple[str, ...] = ()
    used: set[str] = field(default_factory=set)
    reads: set[Read] = field(default_factory=set)
    calls: set[str] = field(default_factory=set)
    passed: dict[tuple[str, str, int], tuple[Value, Word]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)


@dataclass
class Reading:
    """What is known and found while files are read together.

    Attributes:
        names: everything that may be named.
        problems: what is wrong so far.
        scopes: definition or rule → what it uses, and its entry in the file that says it last.
    """

    names: Names = field(default_factory=Names)
    problems: list[Diagnostic] = field(default_factory=list)
    scopes: dict[Read, tuple[Scope, Value]] = field(default_factory=dict)


class Value:
    """What stands at one place of a file: conditions, strings and numbers.

    Attributes:
        reading, scope: what it is read in.
        file, keys: where it stands.
        value: what TOML gives for it.
        at_key: its key is meant, not its value.
    """

    def __init__(
        self, reading: Reading, file: RuleFile, keys: Keys, value: Any,
        scope: Scope | None = None, *, at_key: bool = False,
    ) -> None:  # fmt: skip
        """Nothing is read yet."""
        self.reading, self.names, self.scope = reading, reading.names, scope or Scope()
        self.file, self.keys, self.value, self.at_key = file, keys, value, at_key

    def inner(self, key: str | int) -> Self:
        """The entry under a key of the table or list that stands here."""
        keys = (*self.keys, key)
        return type(self)(self.reading, self.file, keys, self.value[key], self.scope)

    @property
    def key(self) -> Self:
        """The key of the same entry."""
        return type(self)(self.reading, self.file, self.keys, self.value, self.scope, at_key=True)

    def report(
        self, code: str, what: str, allowed: str = "", fix: str = "", *,
        near: tuple[str, Iterable[str]] | None = None, word: Word = None,
    ) -> None:  # fmt: skip
        """A problem here; ``near``: what was written, and the names that may be meant."""
        problems = self.reading.problems
        if near is not None and len(problems) < SUGGESTED:
            fix = did_you_mean(*near) or fix
        within = None if word is None else (word[0], len(word[1]))
        problems.append(
            self.file.diagnostic(
                code, self.keys, what, allowed, fix, key=self.at_key, within=within
            )
        )

    def parsed(self, code: str, read: Callable[[Any], T], text: Any = None) -> T | None:
        """A string that was read; None, with a problem reported, if it is not in the grammar."""
        try:
            return read(self.value if text is None else text)
        except string_parser.GrammarError as error:
            self.report(code, error.what, error.allowed)
            self.unreadable()
            return None

    def unreadable(self) -> None:
        """Part of the definition cannot be read, so its use of roles is unknown."""
        self.scope.used |= set(self.scope.roles)

    # ---- names

    def call(self, call: ast.Call, *wanted: str, by: str = "a condition") -> Callee | None:
        """What a call names; None, and a problem, if it is nothing of a wanted kind that is known."""
        scope, name, word = self.scope, call.name, _word(call.at, 0, call.name)
        callee = self.names.find(name)
        if callee is None:
            self._unknown(call, wanted)
            self.unreadable()
            return None
        scope.calls.add(name)
        if callee.declared:
            scope.reads.add((callee.kind, name))
        if callee.kind not in wanted:
            needed = " or a ".join(wanted)
            fix = f'declare one: [state.NAME] when = {{ "{call}" = "…" }}'
            fix = fix if callee.kind == "signal" and "state" in wanted else ""
            what = f"{name}() is a {callee.kind}; {by} needs a {needed}"
            self.report("R404", what, fix=fix, word=word)
            self.unreadable()
            return None
        arities = callee.arities
        if callee.kind == "signal" and arities is None:
            self.unreadable()
            return None
        if arities is not None and len(call.args) not in arities:
            takes = " or ".join(map(str, arities))
            roles = f"role{'s' if takes != '1' else ''}"
            self.report("R402", f"{name}() takes {takes} {roles}, not {len(call.args)}")
        signal = callee.signal
        for index, arg in enumerate(call.args):
            at = _word(call.at, index + 1, arg)
            if index == 0 and signal is not None and signal.named:
                continue
            if arg in GROUPS or self.role(arg, at):
                scope.passed.setdefault((arg, name, index), (self, at))
        if signal is not None:
            self._needs_of(signal, name)
        return callee

    def _unknown(self, call: ast.Call, wanted: tuple[str, ...]) -> None:
        word, phases = _word(call.at, 0, call.name), self.names.of_kind("phase")
        if "phase" in wanted and not call.args:
            known = ["episode", *phases]
            what, allowed = f'there is no phase called "{call.name}"', ", ".join(known)
            allowed += ", or a state with its roles"
        else:
            known = self.names.of_kind("signal", "state")
            what = f"there is no signal or state called {call.name}()"
            allowed = (
                "built-in signals and relations, and declared states (safestage rules signals)"
            )
        self.report("R401", what, allowed, near=(call.name, known), word=word)

    def _needs_of(self, spec: Signal, name: str) -> None:
        """Whether the options and material columns that a signal needs are there."""
        for option in spec.options:
            if option.required and option.name != spec.named:
                allowed = f'[signal.NAME] with base = "{spec.name}" and {option.name} = …'
                self.report("R414", f'{name}() needs "{option.name}"', allowed)
            if option.param and option.name in self.names.params:
                self.scope.reads.add(("param", option.name))
                given = self.names.params[option.name]
                self.fits(given, option.kind, option.name, f"{option.name} of {name}()")
        for column, dimension in spec.columns:
            self.scope.reads.add(("column", column))
            if column not in self.names.columns:
                what = f'{name}() reads the column "{column}", which no material has'
                allowed = f"[material.default] {column} = {a_dimension(dimension)}"
                self.report("R409", what, allowed)
                continue
            given = self.names.columns[column]
            self.fits(given, dimension, "that of the materials", f"{column} of {name}()")

    def role(self, name: str, word: Word) -> bool:
        """Whether a name is a role here; it then counts as used, and so does one that it misspells."""
        scope = self.scope
        if name in scope.roles:
            scope.used.add(name)
            return True
        known = [*scope.roles, *GROUPS]
        scope.used.add(nearest(name, known))
        what = f'"{name}" is not a role of {scope.label}'
        self.report("R403", what, ", ".join(known), near=(name, known), word=word)
        return False

    def parameter(self, name: str, word: Word = None) -> bool:
        """Whether a name is a parameter; it then counts as read."""
        self.scope.reads.add(("param", name))
        if name in self.names.params:
            return True
        what = f'there is no parameter "{name}"'
        allowed = "a quantity with its unit, or a name declared under [param]"
        self.report("R408", what, allowed, near=(name, self.names.params), word=word)
        return False

    def fits(self, given: str | None, wanted: str, said: str, of: str) -> None:
        """Report a value that is not of the dimension that is wanted; None: it is not known."""
        if given in (None, wanted) or (wanted == "number" and given == "ratio"):
            return  # so is a number without a unit called
        self.report("R407", f"{of} is {an(wanted)}, but {said} is {an(str(given))}", a_dimension(wanted))  # fmt: skip

    def limited(self, value: ast.Value | ast.Duration | None, dimension: str, of: str) -> None:
        """Check what a value names, and whether it is of the dimension of what it is compared with."""
        if isinstance(value, ast.Quantity):
            self.fits(value.dimension, dimension, f'"{value.text}"', of)
        elif isinstance(value, ast.Parameter):
            if self.parameter(value.name, _word(value.at, 0, value.name)):
                self.fits(self.names.params[value.name], dimension, value.name, of)
        elif isinstance(value, ast.Column):
            self._column(value, dimension, of)

    def _column(self, value: ast.Column, dimension: str, of: str) -> None:
        columns, name = self.names.columns, value.name
        if not self.role(value.role, _word(value.at, 1, value.role)):
            return
        self.scope.reads.add(("column", name))
        if name in columns:
            self.fits(columns[name], dimension, f"{name}({value.role})", of)
            return
        allowed = ", ".join(sorted(columns)) or "columns declared in [material.default]"
        word = _word(value.at, 0, name)
        self.report("R409", f'no material has a column "{name}"', allowed, near=(name, columns), word=word)  # fmt: skip

    # ---- quantities and time

    def setting(self) -> ast.Setting | None:
        """The value of a parameter or material column."""
        if isinstance(self.value, bool) or not isinstance(self.value, str | int | float):
            self.report("R306", f"{literal(self.value)} is not a quantity", '"8 cm", "0.5 s", 0.5')
            return None
        return self.parsed("R306", string_parser.setting)

    def settings(self) -> ast.Settings:
        """A table of values of declared parameters."""
        if not isinstance(self.value, dict):
            self.report("R203", "parameter values stand in a table", '{ edge = "3 cm" }')
            return ()
        read = []
        for name in self.value:
            entry = self.inner(name)
            if name not in self.names.params:
                known = self.names.params
                what, allowed = f'there is no parameter "{name}"', ", ".join(sorted(known))
                entry.key.report("R408", what, allowed, near=(name, known))
                continue
            value, wanted = entry.setting(), self.names.params[name]
            if value is not None and wanted is not None:
                entry.fits(dimension_of(value), wanted, literal(entry.value), name)
                read.append((name, value))
        return tuple(read)

    def event(self) -> ast.Event | None:
        """A moment, or the frames of a state."""
        event = self.parsed("R303", string_parser.event)
        self.moment(event)
        return event

    def moment(self, event: ast.Event | None) -> None:
        """Check the state of an event."""
        if event is not None and event.call is not None:
            self.call(event.call, "state", by="an event")

    def lasting(self) -> ast.Lasting | None:
        """A duration, or a parameter that holds one."""
        lasting = self.parsed("R302", string_parser.duration)
        self.limited(lasting, "time", "a duration")
        return lasting

    def span(self) -> ast.Span | None:
        """A stretch of frames."""
        span = self.parsed("R304", string_parser.span)
        return None if span is None else self._span(span)

    def _span(self, span: ast.Span) -> ast.Span:
        """The span with phases recognised."""
        match span:
            case ast.PhaseSpan(call) | ast.StateSpan(call):
                callee = self.call(call, "phase", "state", by="a span")
                is_phase = callee is not None and callee.kind == "phase"
                return ast.PhaseSpan(call) if is_phase else ast.StateSpan(call)
            case ast.Part(_, duration, of):
                self.limited(duration, "time", "a duration")
                return replace(span, of=self._span(of))
            case ast.Around(_, duration, event):
                self.limited(duration, "time", "a duration")
                self.moment(event)
            case ast.FromTo(begin, stop):
                self.moment(begin)
                self.moment(stop)
            case ast.While(of, call):
                kept = self._span(of)
                self.call(call, "state", by='"while"')
                return replace(span, of=kept)
        return span

    # ---- conditions

    def condition(self, depth: int = 1) -> ast.Condition | None:
        """A table whose entries must all hold."""
        table = self.value
        if not isinstance(table, dict):
            allowed = '{ "moved(target)" = true, "tilt(target)" = "<= 15 deg" }'
            self.report("R203", f"a condition is a table, not {literal(table)}", allowed)
        elif not table:
            self.report("R203", "an empty condition says nothing", "at least one entry")
        elif depth > 2:
            fix = "give the inner part a name: [state.NAME]"
            self.report("R207", "nested more than two levels deep", fix=fix)
        else:
            self._twice()
            atoms = [self.inner(key).atom(key, depth) for key in table]
            return ast.Condition(tuple(atom for atom in atoms if atom is not None))
        self.unreadable()
        return None

    def alternative(self, depth: int = 1) -> ast.Alternative | None:
        """An event or state as a string, or a condition as a table."""
        return self.event() if isinstance(self.value, str) else self.condition(depth)

    def listed(self, depth: int = 1) -> tuple[ast.Alternative, ...]:
        """The alternatives of a list."""
        found = [self.inner(index).alternative(depth) for index in range(len(self.value))]
        return tuple(one for one in found if one is not None)

    def alternatives(self) -> tuple[ast.Alternative, ...]:
        """One thing that is forbidden, or a list of them."""
        if isinstance(self.value, list):
            if not self.value:
                self.report("R203", f"an empty list {self.keys[-1]}s nothing")
            return self.listed()
        if isinstance(self.value, dict) and len(self.value) > 1:
            self.key.report(
                "R206", "a table means all of its entries at once; forbidding two things is a list",
                '[{ "a(x)" = true }, { "b(x)" = true }]',
                "put each entry into its own table in a list; if all at once is meant, a list of "
                "this one table",
            )  # fmt: skip
        one = self.alternative()
        return () if one is None else (one,)

    def _twice(self) -> None:
        """TOML refuses a key that stands twice, but not one that is only spaced differently."""
        seen: dict[str, str] = {}
        for key in self.value:
            first = seen.setdefault(re.sub(r"\s+", "", key), key)
            if first != key:
                what = f'"{first}" and "{key}" are one entry, written twice'
                fix = "leave one out; several limits on one signal are a list"
                self.inner(key).key.report("R211", what, fix=fix)

    def atom(self, key: str, depth: int) -> ast.Atom | None:
        """One entry of a condition."""
        if key == "any":
            if isinstance(self.value, list) and self.value:
                return ast.AnyOf(self.listed(depth + 1))
            self.report("R203", '"any" takes a list of alternatives', '["a(x)", { … }]')
            return None
        if key in self.scope.siblings:
            what = f'"{key}" is a key of {self.scope.label}, but stands inside a condition'
            fix = f'write "{key} = …" before the sub-table that swallowed it'
            self.key.report("R204", what, fix=fix)
            return None
        head = self.key.parsed("R307", string_parser.atom, key)
        callee = None if head is None else self.key.signal(head, "signal", "state")
        if head is None or callee is None:
            return None
        if callee.signal is not None:
            return self._limits(head, callee.signal)
        return self._truth(head.call)

    def signal(self, head: ast.SignalAtom, *wanted: str, by: str = "a condition") -> Callee | None:
        """What a call names, perhaps taken since an event; as ``call``."""
        self.moment(head.since)
        callee = self.call(head.call, *wanted, by=by)
        if callee is not None and head.since is not None:
            if callee.signal is None:
                self.report("R406", f"{head.call.name}() is a state: only signals are taken since")
            elif not callee.signal.since:
                what = f'{head.call.name}() has no reference, so it cannot be taken "since"'
                others = ", ".join(one.name for one in SIGNALS.values() if one.since)
                self.report("R406", what, f"signals with a reference: {others}")
        return callee

    def _limits(self, head: ast.SignalAtom, spec: Signal) -> ast.SignalAtom:
        name, limits = head.call.name, []
        several = isinstance(self.value, list)
        for one in [self.inner(i) for i in range(len(self.value))] if several else [self]:
            if not isinstance(one.value, str) or one.value.startswith("at "):
                what = f"{name}() is a signal: it needs a limit, not {literal(one.value)}"
                allowed = f'">= …" with {a_dimension(spec.dimension)}, or a list of limits'
                one.report("R405", what, allowed)
            elif limit := one.parsed("R301", string_parser.limit):
                one.limited(limit.value, spec.dimension, f"{name}()")
                limits.append(limit)
        return replace(head, limits=tuple(limits))

    def _truth(self, call: ast.Call) -> ast.StateAtom | ast.CountAtom | None:
        if isinstance(self.value, bool):
            return ast.StateAtom(call, self.value)
        if not isinstance(self.value, str) or not self.value.startswith("at "):
            what = f"{call.name}() is a state, not a signal: {literal(self.value)} does not fit"
            self.report("R405", what, 'true, false, "at least 2 role", "at most 1 role"')
            return None
        counted = self.parsed("R301", string_parser.count)
        if counted is None:
            return None
        if not self.scope.counting:
            what = "bodies can be counted in rules and goals only, where roles are"
            self.report("R405", what, "true, false")
        elif counted[2] not in call.args:
            what, known = f'"{counted[2]}" is not an argument of {call}', call.args
            self.report("R403", what, ", ".join(known), near=(counted[2], known))
        return ast.CountAtom(call, *counted)

    # ---- operands of computed signals

    def state_operand(self) -> ast.StateAtom | None:
        """A state or relation."""
        call = self.parsed("R307", string_parser.call, str(self.value))
        if call is None or self.call(call, "state", by="holds") is None:
            return None
        return ast.StateAtom(call, True)

    def operand(self) -> ast.Operand | None:
        """A signal, a quantity or a parameter."""
        if isinstance(self.value, bool) or not isinstance(self.value, str | int | float):
            self.report("R416", "this is no operand", '"speed(a)", "2 cm", 0.5, a parameter')
            return None
        operand = self.parsed("R416", string_parser.operand)
        if isinstance(operand, ast.Parameter):
            self.parameter(operand.name)
        elif isinstance(operand, ast.SignalAtom):
            self.signal(operand, "signal", by="an operation")
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


def _word(at: tuple[int, ...], index: int, word: str) -> Word:
    """A word of a string that tells where its words stand; None if it does not."""
    return (at[index], word) if at else None
