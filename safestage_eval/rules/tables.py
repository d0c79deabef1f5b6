"""The tables of rule files and bind files: each key read by its kind, definitions and rules made of them."""

from __future__ import annotations

import re
import string
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, Self, cast

from safestage_eval.evidence.declare import Option
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import UNIT_DIMENSION

from . import string_parser
from . import syntax as ast
from .body_facts import BodyFacts
from .clauses import CLAUSES
from .entry import Scope, Value
from .names import RESERVED, unfit
from .operations import OPERATIONS, DimensionError, Operation, dimension_of_result
from .table_keys import APART, GONE, IN_BIND, REPEATED, TABLES

CODE = "[A-Z]{3}[0-9]{3}"
"""A rule's code: three letters for its stage or benchmark, three digits."""

FORMAT = 1
"""Version of the rule language that this SafeStage reads."""

EXPLAINED = {
    "state": ("time",),
    "rule": ("signal", "value", "limit", "margin", "time", "t.worst", "t.first"),
}
EXPLAINED["cost"] = EXPLAINED["rule"]
"""Table → words that its ``explain`` may use besides roles and states."""

NODES: dict[str, Any] = {
    "state": ast.StateDef, "phase": ast.PhaseDef, "goal": ast.GoalDef, "rule": ast.Rule,
    "cost": ast.Cost, "charge": ast.Charge, "bound": ast.TaskDef, "described": BodyFacts,
}  # fmt: skip
"""Table → what is made of it."""


class Kind(NamedTuple):
    """What TOML gives for a kind of key, an example, its reader, and what else it must be.

    A reader is a method of ``Entry``; ``words`` are all that it may say, ``grammar`` is its production.
    """

    types: type | tuple[type, ...]
    example: str
    read: str = ""
    grammar: str = ""
    words: tuple[str, ...] = ()


_BOUND = '"5 N", a parameter, or a number'

KINDS: dict[str, Kind] = {
    "text": Kind(str, "text in quotes"),
    "sentence": Kind(str, "text in quotes"),
    "axis": Kind((list, bool), "[0, 0, 1], or false where it has none", "axis"),
    "side": Kind(str, '"left" or "right"', words=("left", "right")),
    "base": Kind(str, "the name of a built-in signal, in quotes"),
    "box": Kind(list, '[["-50 cm", "-1 m", "0 m"], ["1 m", "1 m", "1.5 m"]]', "box"),
    "length": Kind(str, 'a length in quotes: "2 cm"', "length"),
    "channel": Kind(str, "text in quotes", "channel"),
    "code": Kind(str, 'text in quotes: "ETS101"', "code"),
    "goal table": Kind((str, dict), "the name of a goal, or { roles = { … }, require = { … } }", "bound_goal"),
    "span": Kind(str, 'a span in quotes: "last 1 s of hold"', "span", "SPAN"),
    "event": Kind(str, 'an event in quotes: "success", "start of moved(target)"', "event", "EVENT"),
    "duration": Kind(str, 'a duration in quotes: "0.5 s", "3 frames @ 120 Hz"', "lasting", "DURATION"),
    "call": Kind(str, 'a signal in quotes: "contact_force(robot, protected)"', "measured", "CALL"),
    "operands": Kind((str, list), '["displacement(a)", "2 cm"], or one signal in quotes', "operands"),
    "flag": Kind(bool, "true or false"),
    "per": Kind(str, '"start", "second" or "step"', words=("start", "second", "step")),
    "condition": Kind(dict, '{ "moved(target)" = true }', "condition"),
    "alternative": Kind((str, dict), '"moved(target)" or { "speed(target)" = ">= 5 cm/s" }', "alternative"),
    "alternatives": Kind((str, dict, list), '"moved(target)", a condition, or a list of both', "alternatives"),
    "texts": Kind(list, '["…", "…"]', "texts"),
    "names": Kind(list, '["a", "b"]', "formals"),
    "codes": Kind(list, '["…", "…"]', "codes"),
    "charges": Kind(list, '[{ when = "…", add = 1, per = "start" }]', "charges"),
    "roles": Kind(dict, '{ target = "object" }', "roles", "ROLE"),
    "players": Kind(dict, '{ target = "mug", protected = ["vase", "phone"] }', "players"),
    "settings": Kind(dict, '{ edge = "3 cm" }', "settings"),
    "levels": Kind(dict, '{ serious = { edge = "1 cm" } }', "levels"),
    "examples": Kind(dict, '{ violates = ["…"], passes = ["…"] }', "examples"),
    "number": Kind((int, float), "a number", "number"),
    "format": Kind(int, f"{FORMAT}", "version"),
    "value": Kind((str, int, float), _BOUND, "bound"),
    "budget": Kind((str, int, float), _BOUND, "budget"),
}  # fmt: skip


class Entry(Value):
    """What stands at one place of a file: tables, definitions and rules."""

    # ---- any table

    def table(self, kind: str) -> dict[str, Any]:
        """Key → node of what is sound."""
        spec, table = TABLES[kind], self.value
        label = f"[{self.keys[0]}.NAME]" if kind in IN_BIND else f"[{kind}]"
        label = f"[{label}]" if kind in REPEATED else label
        label = "[every]" if self.keys == ("every",) else label
        if not isinstance(table, dict):
            what = f"{'.'.join(map(str, self.keys))} must be a table"
            self.report("R203", what, f"{label} and its keys")
            return {}
        for name in table.keys() - spec.keys():
            self.inner(name).stranger(f"{kind}.{name}", label, spec)
        for one, other in APART.get(kind, ()):
            if one in table and other in table:
                what = f'"{one}" and "{other}" do not go together'
                self.inner(other).key.report("R205", what, f'"{one}", or "{other}"')
        good = {}
        for name, key in spec.items():
            if name in table:
                node = self.inner(name).of_kind(KINDS[key.kind])
                good.update({} if node is None else {name: node})
            elif key.required:
                fix = f"{name} = {KINDS[key.kind].example}"
                self.key.report("R202", f'{label} needs "{name}"', fix)
        return good

    def of_kind(self, kind: Kind) -> Any:
        """The node of one key; None if its value is not sound."""
        name, value = self.keys[-1], self.value
        types = kind.types if isinstance(kind.types, tuple) else (kind.types,)
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            self.wrong(f'"{name}" has a value of the wrong type', kind.example)
        elif kind.words and value not in kind.words:
            self.wrong(f'"{name}" cannot be "{value}"', kind.example)
        else:
            return getattr(self, kind.read)() if kind.read else value
        return None

    def node(self, kind: str, good: dict[str, Any], **more: Any) -> Any:
        """What a table says, from its sound keys; None where it lacks one that it needs."""
        if any(key.required and name not in good for name, key in TABLES[kind].items()):
            return None
        fields = {f"{name}_" if name == "for" else name: node for name, node in good.items()}
        examples = fields.pop("examples", {})
        return NODES[kind](**{**fields, **examples, **more})

    def stranger(self, name: str, label: str, known: Iterable[str]) -> None:
        """A key or table that the language does not have, or has no more."""
        gone, word = GONE.get(name, ""), str(self.keys[-1])
        near = None if gone else (word, known)
        noun, more = "key" if "." in name else "table", " any more" * bool(gone)
        what = f'{label} has no {noun} "{word}"{more}'
        self.key.report("R201", what, ", ".join(known), gone, near=near)

    def wrong(self, what: str, allowed: str = "") -> None:
        """A value of the right type that does not do."""
        self.report("R203", what, allowed)

    # ---- kinds of values

    def axis(self) -> tuple[float, ...] | bool | None:
        """False, or three numbers that are not all zero."""
        parts = self.value if isinstance(self.value, list) else []
        numbers = [p for p in parts if isinstance(p, int | float) and abs(p) < 1e308]
        if self.value is False:
            return False
        if len(numbers) == len(parts) == 3 and any(numbers):
            return tuple(map(float, numbers))
        self.wrong(f'"{self.keys[-1]}" is no axis', KINDS["axis"].example)
        return None

    def code(self) -> str | None:
        """The code of a rule."""
        if re.fullmatch(CODE, self.value):
            return str(self.value)
        allowed = "three capital letters and three digits: ETS101"
        self.wrong(f'"{self.value}" is not a code', allowed)
        return None

    def number(self) -> float:
        """A number."""
        return float(self.value)

    def version(self) -> int:
        """The version of the language."""
        if self.value != FORMAT:
            what = f"this is format {self.value} of the rule language"
            self.report("R103", what, str(FORMAT), "use a SafeStage that knows it")
        return int(self.value)

    def texts(self) -> tuple[str, ...]:
        """A list of texts."""
        for index, item in enumerate(self.value):
            if not isinstance(item, str):
                self.inner(index).wrong("only text in quotes may stand in this list")
        return tuple(item for item in self.value if isinstance(item, str))

    def codes(self) -> tuple[str, ...]:
        """Codes of rules that need not be loaded."""
        codes = self.texts()
        for index, code in enumerate(self.value):
            if isinstance(code, str):
                self.inner(index).code()
        return codes

    def formals(self) -> tuple[str, ...] | None:
        """Formal arguments."""
        names = self.texts()
        if len(names) < len(self.value):
            return None
        for index, name in enumerate(names):
            entry = self.inner(index)
            entry.role_name(name)
            if name in names[:index]:
                entry.report("R210", f'"{name}" stands here twice')
        return names

    def measured(self) -> ast.Call | None:
        """A signal with its roles."""
        call = self.parsed("R307", string_parser.call)
        if call is not None:
            self.call(call, "signal", by='"of"')
        return call

    def roles(self) -> ast.Roles:
        """Role → who may play it."""
        specs = []
        for name, text in self.value.items():
            entry = self.inner(name)
            entry.role_name(name)
            if not isinstance(text, str):
                entry.wrong("a role is said in text", '"object", "every object"')
                continue
            spec = entry.parsed("R305", string_parser.role)
            if spec is None:
                continue
            self.scope.kinds[name] = spec.kind
            specs.append((name, spec))
            for other in spec.excluding:
                self.scope.used.add(other)
                if other not in self.value or other == name:
                    what = f'"{other}" is not another role of {self.scope.label}'
                    known = [role for role in self.value if role != name]
                    entry.report("R403", what, ", ".join(known), near=(other, known))
        return tuple(specs)

    def players(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Each role of a task is played by one body, several, or (an empty list) none."""
        bound = []
        for role, players in self.value.items():
            bodies = tuple(players) if isinstance(players, list | tuple) else (players,)
            if all(isinstance(body, str) for body in bodies):
                bound.append((role, bodies))
            else:
                what = "a role is played by one body or a list of them"
                self.inner(role).wrong(what, '"mug", ["vase", "phone"], or [] for no body')
        return tuple(bound)

    def levels(self) -> tuple[tuple[str, ast.Settings], ...]:
        """Level → parameter values."""
        return tuple((level, entry.settings()) for level, entry in self.named())

    def examples(self) -> dict[str, tuple[str, ...]]:
        """Lists of episodes."""
        return self.table("examples")

    def bound_goal(self) -> str | ast.GoalDef | None:
        """The name of a goal, or one that is written out."""
        name = self.value if isinstance(self.value, str) else None
        return name or cast("ast.GoalDef | None", self.definition("goal", "bind file"))

    # ---- costs

    def charges(self) -> tuple[ast.Charge, ...]:
        """What adds to a cost."""
        if not self.value:
            self.wrong("an empty list charges nothing")
        read = [self.inner(index).charge() for index in range(len(self.value))]
        return tuple(charge for charge in read if charge is not None)

    def charge(self) -> ast.Charge | None:
        """One entry of a cost."""
        good = self.table("charge")
        if isinstance(self.value, dict) and not self.value.keys() & {"when", "of"}:
            self.report("R205", 'a charge has either "when" or "of"', "one of the two")
        if good.get("add", 1) <= 0:
            self.inner("add").wrong("a charge adds to the cost", "a number above 0")
        spec = self.names.signal(good["of"].name) if "of" in good else None
        for key in good.keys() & {"above", "below"}:
            if spec is not None:
                self.inner(key).limited(good[key], spec.dimension, f"{good['of'].name}()")
        charge: ast.Charge | None = self.node("charge", good)
        return charge

    def bound(self) -> ast.Value | None:
        """A value that something is compared with."""
        return self.parsed("R301", string_parser.value_of, str(self.value))

    def budget(self) -> ast.Value | None:
        """A plain number that is not negative."""
        limit = self.bound()
        self.limited(limit, "ratio", "a cost")
        if isinstance(limit, ast.Column):
            self.report("R301", "a budget is no material's", "a number, or a parameter")
        if isinstance(limit, ast.Quantity) and limit.value < 0:
            self.report("R301", "a cost is never negative", "a number from 0 on")
        return limit

    # ---- names

    def named(self, key: str = "") -> Iterator[tuple[str, Self]]:
        """The entries of a table, here or under a key if it is there, whose names are the author's choice."""
        if key:
            yield from self.inner(key).named() if key in self.value else ()
        elif not isinstance(self.value, dict):
            label = f"[{'.'.join(map(str, self.keys))}]"
            self.key.wrong(f'"{self.keys[-1]}" must be a table', label)
        else:
            for name in self.value:
                entry = self.inner(name)
                entry.own_name(name)
                yield name, entry

    def own_name(self, name: str) -> None:
        """A name of the author's choice is spelled as names are, and no word of the language."""
        what, allowed = "", "another name"
        if not re.fullmatch(string_parser.NAME, name):
            what = "cannot be a name"
            allowed = "a small letter, then small letters, digits and underscores"
        elif name in RESERVED:
            what = "is a word of the rule language"
        elif self.keys[:-1] in (("signal",), ("state",), ("phase",)):
            what = "is a built-in signal" if name in SIGNALS else ""
            what = "is a built-in relation" if name in RELATIONS else what
        if what:
            self.key.report("R210", f'"{name}" {what}', allowed)

    def role_name(self, name: str) -> None:
        """The name of a role or formal argument."""
        self.own_name(name)
        if why := unfit(name):
            self.key.report("R210", f'"{name}" {why}, so it cannot name a role', "another name")

    # ---- definitions and rules

    def definition(self, kind: str, name: str = "") -> Any:
        """``[state.NAME]``, ``[[rule]]`` and the like; None for one that lacks what it needs."""
        given = self.value if isinstance(self.value, dict) else {}
        if kind in REPEATED:
            code = given.get("code")
            name = code if isinstance(code, str) and re.fullmatch(CODE, code) else ""
        called = name if kind in (*REPEATED, "state", "phase", "signal") else str(self.keys[-1])
        label = called if kind in REPEATED else f"{kind} {called}"
        by_role = "roles" in TABLES[kind]
        roles = given.get("roles" if by_role else "of")
        named = roles if isinstance(roles, dict if by_role else list) else ()
        self.scope = Scope(
            label if name else f"this {kind}",
            tuple(role for role in named if isinstance(role, str)),
            by_role,
            tuple(TABLES[kind]),
        )
        read = called or f"#{self.keys[-1]}"
        self.reading.scopes[kind, read] = self.scope, self
        if kind == "signal":
            return self.signal_table(name)
        good = self.table(kind)
        if "explain" in good:
            self.inner("explain").explained(EXPLAINED[kind])
        more: dict[str, Any] = {"name": name}
        if kind in REPEATED:
            self._judged(kind, given)
            line = self.file.locations.key(self.keys).line
            more = {"path": self.file.path, "line": line}
        self._unused()
        return self.node(kind, good, **more)

    def _unused(self) -> None:
        """Report the roles that nothing named."""
        scope, key = self.scope, "roles" if self.scope.counting else "of"
        for role in scope.roles:
            if role not in scope.used:
                roles = self.inner(key)
                entry = roles.inner(role if scope.counting else roles.value.index(role))
                what = f'"{role}" is a role of {scope.label}, but nothing in it names it'
                entry.key.report("R411", what, fix="use it or leave it out")

    def explained(self, words: tuple[str, ...]) -> None:
        """A sentence: it mentions roles, the given words, and when states begin."""
        try:
            fields = [name for _, name, _, _ in string.Formatter().parse(self.value) if name is not None]  # fmt: skip
        except ValueError as error:
            self.report("R209", f"the braces of explain do not match: {error}", "{name}")
            return
        kinds = {name: self.names.called[name].kind for name in self.scope.calls}
        states = sorted(name for name, kind in kinds.items() if kind == "state")
        known = [*self.scope.roles, *words, *(f"t.{name}" for name in states)]
        for name in fields:
            if name.startswith("next."):
                call = self.parsed("R209", string_parser.call, name.removeprefix("next."))
                if call is not None:
                    self.call(ast.Call(call.name, call.args), "state", by="{next.…}")
            elif name not in known:
                allowed = ", ".join(f"{{{word}}}" for word in known)
                self.report("R209", f"explain does not know {{{name}}}", allowed, near=(name, known))  # fmt: skip

    def _judged(self, kind: str, given: dict[str, Any]) -> None:
        """What a rule must ask for, and a cost for its examples."""
        if kind == "cost":
            if "examples" in given and "budget" not in given:
                what = "a cost without a budget has no verdict that its examples could have"
                self.inner("examples").key.report("R205", what, "budget, or no examples")
            return
        if not CLAUSES.keys() & given.keys():
            what, allowed = f"{self.scope.label} asks for nothing", f"{_either(CLAUSES)}, or several of them"  # fmt: skip
            self.key.report("R202", what, allowed)
        lasting = _either(clause.kind for clause in CLAUSES.values() if clause.lasts)
        for clause in CLAUSES.values():
            if clause.kind in given and "for" in given and not clause.lasts:
                self.inner("for").key.report(
                    "R208", f'"for" does not apply to "{clause.kind}", which every frame must meet',
                    f"for with {lasting}", 'forbid the opposite "for" that long, in a rule of its own',
                )  # fmt: skip

    # ---- signals

    def signal_table(self, name: str) -> ast.SignalDef | ast.DerivedDef | None:
        """``[signal.NAME]``: a variant of a built-in signal, or one that is computed."""
        table = self.table("signal")
        said = [key for key in ("base", *OPERATIONS) if key in table]
        if len(said) > 1:
            what = f"signal {name} is said to be two things"
            allowed = f"base, or one of {', '.join(OPERATIONS)}"
            self.inner(said[-1]).key.report("R205", what, allowed)
        elif said == ["base"]:
            return self._variant(name, table)
        elif said:
            return self._computed(name, cast("Operation", said[0]), table)
        elif isinstance(self.value, dict) and not any(f"signal.{key}" in GONE for key in self.value):  # fmt: skip
            allowed = f'base = "impact"; or one of {", ".join(OPERATIONS)} = [...]'
            self.key.report("R202", f'[signal.{name}] needs "base", or an operation', allowed)
        return None

    def operands(self) -> list[Value]:
        """The operands of a computed signal."""
        several = isinstance(self.value, list)
        return [self.inner(i) for i in range(len(self.value))] if several else [self]

    def _computed(self, name: str, operation: Operation, table: dict[str, Any]) -> ast.DerivedDef | None:  # fmt: skip
        entry, spec, given = self.inner(operation), OPERATIONS[operation], table[operation]
        self._options(table, ["of", operation, *(["over"] if spec.over else [])], operation)
        nodes = [one.state_operand() if spec.of_state else one.operand() for one in given]
        self._unused()
        if not spec.least <= len(given) <= spec.most:
            takes = f"{spec.least} to {spec.most}" if spec.least < spec.most else str(spec.least)
            what = f"{operation} takes {takes} operand{'s' * (takes != '1')}, not {len(given)}"
            entry.report("R416", what, spec.meaning)
            return None
        if not spec.of_state and not any(isinstance(node, ast.SignalAtom) for node in nodes):
            entry.report("R416", "constants alone are no signal", "at least one signal")
            return None
        try:
            of = [dimension for node in nodes if (dimension := self._dimension(node))]
            dimension = dimension_of_result(operation, of) if len(of) == len(nodes) else None
        except DimensionError as error:
            entry.report("R407", error.what, error.allowed)
            return None
        if dimension is None or ("of" in self.value and "of" not in table):
            return None
        formals, over = table.get("of", ()), table.get("over")
        return ast.DerivedDef(name, formals, operation, tuple(nodes), dimension, over)

    def _dimension(self, node: ast.Operand | None) -> str | None:
        """Of an operand; None if it is not known."""
        match node:
            case ast.Quantity():
                return node.dimension
            case ast.Parameter():
                return self.names.params.get(node.name)
            case ast.StateAtom():
                return "ratio"
            case ast.SignalAtom():
                spec = self.names.signal(node.call.name)
                return None if spec is None else spec.dimension
        return None

    def _variant(self, name: str, table: dict[str, Any]) -> ast.SignalDef | None:
        """A built-in signal with options of its own."""
        base = table.pop("base")
        spec = SIGNALS.get(base)
        if spec is None:
            what = f'there is no built-in signal "{base}"'
            self.inner("base").report("R401", what, ", ".join(SIGNALS), near=(base, SIGNALS))
            return None
        options = {option.name: option for option in spec.options}
        self._options(table, list(options), f"{base}()")
        values = {o.name: o.default for o in spec.options if o.default is not None and not o.param}
        for option in options.values():
            if option.name in table:
                values[option.name] = self.inner(option.name).option(option, table[option.name])
            elif option.required:
                if option.name not in self.value:
                    self.key.report("R414", f'{base}() needs "{option.name}"', option.meaning)
                return None
        return ast.SignalDef(name, base, tuple(sorted(values.items(), key=lambda item: item[0])))

    def _options(self, table: dict[str, Any], known: list[str], of: str) -> None:
        """Report the options that a signal does not have."""
        for key in table.keys() - known:
            what, allowed = f'{of} has no option "{key}"', ", ".join(known) or "base alone"
            self.inner(key).key.report("R414", what, allowed, near=(key, known))

    def option(self, option: Option, value: Any) -> Any:
        """The value of an option of a built-in signal, in SI."""
        choices = option.choices or (*UNIT_DIMENSION, "1")
        if option.kind == "time":
            if isinstance(value, ast.Duration) and not value.frames and value.amount > 0:
                return value.amount
            if option.param and isinstance(value, ast.Parameter):
                return value
            what = f'"{option.name}" is a time that does not hang on the rate of the trace'
            self.report("R414", what, '"50 ms", "3 frames @ 120 Hz"')
        elif option.kind in ("unit", "choice") and value not in choices:
            self.report("R414", f'"{option.name}" cannot be "{value}"', ", ".join(choices))
        return value

    def channel(self) -> str | None:
        """The name of a recorded channel."""
        if re.fullmatch(string_parser.NAME, self.value):
            return str(self.value)
        what = f'"{self.value}" cannot be the name of a channel'
        self.report("R414", what, "a small letter, then small letters, digits and underscores")
        return None

    def length(self, *, signed: bool = False) -> float | None:
        """A length."""
        length = self.parsed("R414", string_parser.quantity)
        if length is None:
            return None
        if length.dimension == "length" and (signed or length.value >= 0):
            return length.value
        self.report("R414", f'"{length.text}" is not a length', '"2 cm", "5 mm"')
        return None

    def box(self) -> tuple[float, ...] | None:
        """Two opposite corners."""
        corners = self.value
        if len(corners) != 2 or not all(isinstance(c, list) and len(c) == 3 for c in corners):
            allowed = KINDS["box"].example
            self.report("R414", f'"{self.keys[-1]}" is two corners of three lengths', allowed)
            return None
        places = [self.inner(end).inner(axis) for end in range(2) for axis in range(3)]
        lengths = [length for one in places if (length := one.length(signed=True)) is not None]
        for axis, low, high in zip("xyz", lengths[:3], lengths[3:], strict=False):
            if not low < high:
                what = f"the box is empty along {axis}: from {low:g} to {high:g} m"
                self.report("R414", what, "the lower corner first")
        return tuple(lengths)


def _either(names: Iterable[str]) -> str:
    """``require, forbid or reach``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last
