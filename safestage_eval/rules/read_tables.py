"""The tables of one rule file, read once: definitions, rules and costs of the syntax tree, or problems."""

from __future__ import annotations

import re
import string
from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS

from . import string_parser
from . import syntax as ast
from .clauses import CLAUSES
from .names import RESERVED, operands_of, unfit
from .operations import OPERATIONS, DimensionError, Operation, dimension_of_result
from .read_values import Place, Read, Scope, Values
from .signal_options import read_option, read_options
from .table_keys import IN_BIND, NAMED, REPEATED, TABLES, TOP

CODE = "[A-Z]{3}[0-9]{3}"
"""A rule's code: three letters for its stage or benchmark, three digits."""

FORMAT = 1
"""Version of the rule language that this SafeStage reads."""

WORDS = ("signal", "value", "limit", "margin", "time", "t.worst", "t.first")
"""Words that a rule's ``explain`` may use besides roles and states."""


class _Type(NamedTuple):
    """What TOML gives for a kind of key, an example of it, and its reader where there is more to it than the type."""

    types: type | tuple[type, ...]
    example: str
    read: str = ""


KINDS: dict[str, _Type] = {
    "text": _Type(str, "text in quotes"),
    "sentence": _Type(str, "text in quotes"),
    "axis": _Type((list, bool), "[0, 0, 1], or false where it has none", "axis"),
    "side": _Type(str, '"left" or "right"', "side"),
    "base": _Type(str, "the name of a built-in signal, in quotes"),
    "box": _Type(list, '[["-50 cm", "-1 m", "0 m"], ["1 m", "1 m", "1.5 m"]]'),
    "code": _Type(str, 'text in quotes: "ETS101"', "code"),
    "goal": _Type(str, "the name of a goal, in quotes", "declared"),
    "family": _Type(str, "text in quotes", "declared"),
    "goal table": _Type((str, dict), "the name of a goal, or { roles = { … }, require = { … } }", "bound_goal"),
    "span": _Type(str, 'a span in quotes: "last 1 s of hold"', "span"),
    "event": _Type(str, 'an event in quotes: "success", "start of moved(target)"', "event"),
    "duration": _Type(str, 'a duration in quotes: "0.5 s", "3 frames @ 120 Hz"', "lasting"),
    "call": _Type(str, 'a signal in quotes: "contact_force(robot, protected)"', "signal_call"),
    "operands": _Type((str, list), '["displacement(a)", "2 cm"], or one signal in quotes'),
    "flag": _Type(bool, "true or false", "flag"),
    "per": _Type(str, '"start", "second" or "step"', "per"),
    "condition": _Type(dict, '{ "moved(target)" = true }', "condition"),
    "alternative": _Type((str, dict), '"moved(target)" or { "speed(target)" = ">= 5 cm/s" }', "alternative"),
    "alternatives": _Type((str, dict, list), '"moved(target)", a condition, or a list of both', "alternatives"),
    "texts": _Type(list, '["…", "…"]', "texts"),
    "names": _Type(list, '["a", "b"]', "declared_names"),
    "rules": _Type(list, '["…", "…"]', "assigned"),
    "codes": _Type(list, '["…", "…"]', "codes"),
    "charges": _Type(list, '[{ when = "…", add = 1, per = "start" }]', "charges"),
    "roles": _Type(dict, '{ target = "object" }', "roles"),
    "players": _Type(dict, '{ target = "mug", protected = ["vase", "phone"] }', "players"),
    "settings": _Type(dict, '{ edge = "3 cm" }', "settings"),
    "levels": _Type(dict, '{ serious = { edge = "1 cm" } }', "levels"),
    "examples": _Type(dict, '{ violates = ["…"], passes = ["…"] }', "examples"),
    "number": _Type((int, float), "a number", "number"),
    "format": _Type(int, f"{FORMAT}", "version"),
    "value": _Type((str, int, float), '"5 N", a parameter, or a number'),
    "budget": _Type((str, int, float), '"5 N", a parameter, or a number', "budget"),
}  # fmt: skip


class Tables(Values):
    """Reads the tables of one file.

    Attributes:
        scopes: definition or rule → what it uses.
    """

    scopes: dict[Read, Scope]

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.scopes = {}

    def table(
        self, kind: str, table: Any, here: Place, scope: Scope, *, skip: Iterable[str] = ()
    ) -> dict[str, Any]:
        """Key → node of what is sound in a table; ``skip``: keys that stay as TOML has them."""
        spec, keys = TABLES[kind], here.keys
        label = f"[[{kind}]]" if kind in REPEATED else f"[{kind}]"
        label = f"[{keys[0]}.NAME]" if kind in IN_BIND else label
        label = "[every]" if keys == ("every",) else label
        if not isinstance(table, dict):
            what = f"{'.'.join(map(str, keys))} must be a table"
            self.report("R203", here, what, f"{label} and its keys")
            return {}
        for name in table.keys() - spec.keys():
            what = f'{label} has no key "{name}"'
            self.report(
                "R201", here.inner(name, key=True), what, ", ".join(spec), near=(name, spec)
            )
        good = {}
        for name, key in spec.items():
            if name not in table:
                if key.required:
                    fix = f"{name} = {KINDS[key.kind].example}"
                    self.report("R202", here.at_key, f'{label} needs "{name}"', fix)
                continue
            at, value, (types, example, read) = here.inner(name), table[name], KINDS[key.kind]
            if (key.kind != "axis" and isinstance(value, bool) != (types is bool)) or not isinstance(value, types):  # fmt: skip
                self.report("R203", at, f'"{name}" has a value of the wrong type', example)
                continue
            node = getattr(self, read)(value, at, scope) if read and name not in skip else value
            if node is not None:
                good[name] = node
        return good

    def wrong(self, here: Place, what: str, allowed: str = "") -> None:
        """A value of the right type that does not do."""
        self.report("R203", here, what, allowed)

    # ---- kinds of values; each takes what TOML gives, its place and the scope, and returns a node

    def axis(self, value: Any, here: Place, _: Scope) -> tuple[float, ...] | bool | None:
        """False, or three numbers that are not all zero."""
        if value is False:
            return False
        parts = value if isinstance(value, list) else []
        numbers = [p for p in parts if isinstance(p, int | float) and abs(p) < 1e308]
        if len(numbers) == len(parts) == 3 and any(numbers):
            return tuple(map(float, numbers))
        return self.wrong(here, f'"{here.keys[-1]}" is no axis', KINDS["axis"].example)

    def side(self, value: str, here: Place, _: Scope) -> str | None:
        """Left or right."""
        if value in ("left", "right"):
            return value
        return self.wrong(here, f'"{here.keys[-1]}" is no side', KINDS["side"].example)

    def code(self, value: str, here: Place, _: Scope) -> str | None:
        """The code of a rule."""
        if re.fullmatch(CODE, value):
            return value
        return self.wrong(here, f'"{value}" is not a code', "three capital letters and three digits: ETS101")  # fmt: skip

    def per(self, value: str, here: Place, _: Scope) -> str | None:
        """What is charged for."""
        if value in ("start", "second", "step"):
            return value
        return self.wrong(here, f'nothing can be charged per "{value}"', KINDS["per"].example)

    def flag(self, value: bool, *_: Any) -> bool | None:
        """True, or nothing."""
        return value or None

    def number(self, value: float, *_: Any) -> float:
        """A number."""
        return float(value)

    def version(self, value: int, here: Place, _: Scope) -> int:
        """The version of the language."""
        if value != FORMAT:
            what, fix = (
                f"this is format {value} of the rule language",
                "use a SafeStage that knows it",
            )
            self.report("R103", here, what, str(FORMAT), fix)
        return value

    def texts(self, items: list[Any], here: Place, _: Scope) -> tuple[str, ...]:
        """A list of texts."""
        for index, item in enumerate(items):
            if not isinstance(item, str):
                self.wrong(here.inner(index), "only text in quotes may stand in this list")
        return tuple(item for item in items if isinstance(item, str))

    def declared_names(self, items: list[Any], here: Place, scope: Scope) -> tuple[str, ...]:
        """Formal arguments."""
        names = self.texts(items, here, scope)
        if len(names) == len(items):
            for index, name in enumerate(names):
                at = here.inner(index)
                self._role_name(name, at)
                if name in names[:index]:
                    self.report("R210", at, f'"{name}" stands here twice')
        return names

    def assigned(self, items: list[Any], here: Place, scope: Scope) -> tuple[str, ...]:
        """Codes of rules that there are."""
        codes, known = self.texts(items, here, scope), self.names.rules
        for index, code in enumerate(codes):
            if code not in known:
                allowed = ", ".join(sorted(known)) or "codes of rules"
                what = f'there is no rule "{code}"'
                self.report("R401", here.inner(index), what, allowed, near=(code, known))
        return codes

    def codes(self, items: list[Any], here: Place, scope: Scope) -> tuple[str, ...]:
        """Codes of rules that need not be loaded."""
        codes = self.texts(items, here, scope)
        for index, code in enumerate(codes):
            self.code(code, here.inner(index), scope)
        return codes

    def declared(self, name: str, here: Place, _: Scope) -> str:
        """The name of a goal or family that there is."""
        kind = str(here.keys[-1])
        among = self.names.goals if kind == "goal" else self.names.families
        if name not in among:
            allowed = ", ".join(sorted(among)) or f"a [{kind}.NAME] of this file or one it extends"
            self.report("R401", here, f'there is no {kind} "{name}"', allowed, near=(name, among))
        return name

    def bound_goal(self, value: Any, here: Place, _: Scope) -> str | ast.GoalDef | None:
        """The name of a goal, or one that is written out."""
        return value if isinstance(value, str) else self.goal("bind file", value, here)

    def signal_call(self, text: str, here: Place, scope: Scope) -> ast.Call | None:
        """A signal with its roles."""
        call = self.parsed("R307", here, string_parser.call, text)
        if call is not None and self.call(call, here, scope) == "state":
            self.report("R404", here, f"{call.name}() is a state", "a signal, or: when")
        return call

    def alternatives(self, value: Any, here: Place, scope: Scope) -> tuple[ast.Alternative, ...]:
        """One thing that is forbidden, or a list of them."""
        if isinstance(value, dict) and len(value) > 1:
            self.report(
                "R206", here.at_key, "a table means all of its entries at once; forbidding two "
                "things is a list", '[{ "a(x)" = true }, { "b(x)" = true }]',
                "put each entry into its own table in a list; if all at once is meant, a list of "
                "this one table",
            )  # fmt: skip
        if isinstance(value, list):
            if not value:
                self.wrong(here, f"an empty list {here.keys[-1]}s nothing")
            return self.listed(value, here, scope)
        one = self.alternative(value, here, scope)
        return () if one is None else (one,)

    def roles(self, table: dict[str, Any], here: Place, scope: Scope) -> ast.Roles:
        """Role → who may play it."""
        specs = []
        for name, text in table.items():
            at = here.inner(name)
            self._role_name(name, at)
            if not isinstance(text, str):
                self.wrong(at, "a role is said in text", '"object", "every object"')
                continue
            spec = self.parsed("R305", at, string_parser.role, text)
            if spec is None:
                continue
            scope.kinds[name] = spec.kind
            specs.append((name, spec))
            for other in spec.excluding:
                scope.used.add(other)
                if other not in table or other == name:
                    what = f'"{other}" is not another role of {scope.label}'
                    allowed = ", ".join(role for role in table if role != name)
                    self.report("R403", at, what, allowed, near=(other, table))
        return tuple(specs)

    def players(self, table: dict[str, Any], here: Place, _: Scope) -> Any:
        """Each role of a task is played by one body, several, or (an empty list) none."""
        bound = []
        for role, players in table.items():
            bodies = tuple(players) if isinstance(players, list | tuple) else (players,)
            if all(isinstance(body, str) for body in bodies):
                bound.append((role, bodies))
            else:
                allowed = '"mug", ["vase", "phone"], or [] for no body'
                what = "a role is played by one body or a list of them"
                self.wrong(here.inner(role), what, allowed)
        return tuple(bound)

    def settings(self, values: Any, here: Place, _: Scope) -> ast.Settings:
        """A table of parameter values."""
        if not isinstance(values, dict):
            self.wrong(here, "parameter values stand in a table", '{ edge = "3 cm" }')
            return ()
        read = [
            (name, self.setting(name, value, here.inner(name))) for name, value in values.items()
        ]
        return tuple((name, value) for name, value in read if value is not None)

    def levels(self, table: dict[str, Any], here: Place, scope: Scope) -> Any:
        """Level → parameter values."""
        for level in table:
            self.declared_name(level, here.inner(level))
        return tuple(
            (n, self.settings(values, here.inner(n), scope)) for n, values in table.items()
        )

    def examples(self, table: Any, here: Place, scope: Scope) -> dict[str, tuple[str, ...]]:
        """Lists of episodes."""
        return self.table("examples", table, here, scope)

    def charges(self, items: list[Any], here: Place, scope: Scope) -> tuple[ast.Charge, ...]:
        """What adds to a cost."""
        if not items:
            self.wrong(here, "an empty list charges nothing")
        read = [self._charge(item, here.inner(index), scope) for index, item in enumerate(items)]
        return tuple(charge for charge in read if charge is not None)

    def _charge(self, value: Any, here: Place, scope: Scope) -> ast.Charge | None:
        good = self.table("charge", value, here, scope)
        if isinstance(value, dict) and ("when" in value) == ("of" in value):
            self.report("R205", here, 'a charge has either "when" or "of"', "one of the two")
        if good.get("add", 1) <= 0:
            self.wrong(here.inner("add"), "a charge adds to the cost", "a number above 0")
        given = value if isinstance(value, dict) else {}
        for limit in ("above", "below", "whole"):
            if limit in given and "when" in given:
                self.report("R205", here.inner(limit, key=True), f'"{limit}" goes with "of" only')
            if "below" in given and limit in given and limit != "below":
                self.report(
                    "R205", here.inner(limit, key=True), f'"{limit}" and "below" do not go together: '
                    "what is charged is too much, or too little", f'"{limit}" or "below"',
                )  # fmt: skip
        for limit in good.keys() & {"above", "below"}:
            at = here.inner(limit)
            bound = self.parsed("R301", at, string_parser.value_of, str(good.pop(limit)))
            spec = self.names.signal(good["of"].name) if "of" in good else None
            if bound is not None and spec is not None:
                self.limited(bound, spec.dimension, f"{spec.name}()", at, scope)
            good[limit] = bound
        return ast.Charge(**good) if good.keys() >= {"add", "per"} else None

    def budget(self, value: Any, here: Place, scope: Scope) -> ast.Value | None:
        """A plain number that is not negative."""
        limit = self.parsed("R301", here, string_parser.value_of, str(value))
        if limit is None:
            return None
        self.limited(limit, "ratio", "a cost", here, scope)
        if isinstance(limit, ast.Column):
            self.report("R301", here, "a budget is no material's", "a number, or a parameter")
        if isinstance(limit, ast.Quantity) and limit.value < 0:
            self.report("R301", here, "a cost is never negative", "a number from 0 on")
        return limit

    def explain(self, text: str, here: Place, scope: Scope, words: tuple[str, ...]) -> None:
        """A sentence: it mentions roles, the given words, and when states begin."""
        try:
            fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        except ValueError as error:
            self.report("R209", here, f"the braces of explain do not match: {error}", "{name}")
            return
        states = [f"t.{name}" for name in sorted(scope.calls) if self.names.is_state(name)]
        allowed = [*scope.roles, *words, *states]
        for name in fields:
            if name.startswith("next."):
                said = name.removeprefix("next.")
                call = self.parsed("R209", here, string_parser.call, said)
                if call and self.call(call, here._replace(exact=False), scope) == "signal":
                    what = f"{call.name}() is a signal, and has no start"
                    self.report("R209", here, what, "a state")
            elif name not in allowed:
                shown = ", ".join(f"{{{word}}}" for word in allowed)
                what = f"explain does not know {{{name}}}"
                self.report("R209", here, what, shown, near=(name, allowed))

    # ---- names

    def declared_name(self, name: str, here: Place) -> None:
        """A name of the author's choice must be spelled as names are, and be no word of the language."""
        if not re.fullmatch(string_parser.NAME, name):
            allowed = "a small letter, then small letters, digits and underscores"
            self.report("R210", here.at_key, f'"{name}" cannot be a name', allowed)
        elif name in RESERVED:
            what = f'"{name}" is a word of the rule language'
            self.report("R210", here.at_key, what, "another name")

    def _role_name(self, name: str, here: Place) -> None:
        self.declared_name(name, here)
        why = unfit(name)
        if why and not why.startswith("is a word"):
            what = f'"{name}" {why}, so it cannot name a role'
            self.report("R210", here.at_key, what, "another name")

    def scope(self, read: Read, label: str, roles: Any = (), kind: str = "") -> Scope:
        """An empty scope for a definition, kept under its kind and name."""
        named = tuple(role for role in roles if isinstance(role, str)) if isinstance(roles, list | dict) else ()  # fmt: skip
        scope = Scope(label, named, isinstance(roles, dict), tuple(TABLES[kind]) if kind else ())
        self.scopes[read] = scope
        return scope

    def _formals(self, kind: str, name: str, table: Any) -> Scope:
        of = table.get("of") if isinstance(table, dict) else None
        return self.scope((kind, name), f"{kind} {name}", of, kind)

    def _unused(self, scope: Scope, here: Place) -> None:
        """Report the roles that nothing named."""
        for index, role in enumerate(scope.roles):
            if role not in scope.used:
                at = here.inner(index if here.keys[-1] == "of" else role, key=True)
                what = f'"{role}" is a role of {scope.label}, but nothing in it names it'
                self.report("R411", at, what, fix="use it or leave it out")

    # ---- definitions

    def strangers(self) -> None:
        """What stands at the top of the file and should not, or stands there in the wrong shape."""
        for name, value in self.file.table.items():
            here = Place((name,), key=True)
            if name not in TOP:
                what = f'a rule file has no table "{name}"'
                self.report("R201", here, what, ", ".join(TOP), near=(name, TOP))
            elif name in REPEATED and not isinstance(value, list):
                self.report("R203", here, f"[{name}] is repeated, one for each", f"[[{name}]]")
            elif name not in REPEATED and not isinstance(value, dict):
                self.report("R203", here, f'"{name}" must be a table', f"[{name}]")

    def head(self) -> dict[str, Any]:
        """``[ruleset]``."""
        if "ruleset" in self.file.table:
            return self.table("ruleset", self.file.table["ruleset"], Place(("ruleset",)), Scope(""))
        self.report(
            "R202", Place(()), "the file does not say that it is a rule file",
            '[ruleset] format = 1, name = "…", version = "1.0.0"', "begin it with [ruleset]",
        )  # fmt: skip
        return {}

    def baseline(self, table: Any) -> ast.Span | None:
        """``[baseline]``: the first frames."""
        scope = self.scope(("baseline", ""), "[baseline]")
        span = self.table("baseline", table, Place(("baseline",)), scope).get("span")
        first = isinstance(span, ast.Part) and span.which == "first"
        if span and not (first and isinstance(span.duration, ast.Duration) and isinstance(span.of, ast.Whole)):  # fmt: skip
            self.report(
                "R304", Place(("baseline", "span")), "the baseline is the first frames of the episode",
                '"first 5 frames of episode", "first 0.1 s of episode"',
            )  # fmt: skip
        return span

    def material(self, name: str, row: Any) -> dict[str, ast.Quantity]:
        """``[material.NAME]``: column → value."""
        here = Place(("material", name))
        self.declared_name(name, here)
        if not isinstance(row, dict):
            self.wrong(here, "a material is a table of columns", "[material.bottle]")
            return {}
        columns = {}
        for column, value in row.items():
            at = here.inner(column)
            self.declared_name(column, at)
            quantity = self.value_of(value, at)
            if isinstance(quantity, ast.Duration):
                self.report("R407", at, "a column holds quantities, not durations")
            elif quantity is not None:
                columns[column] = quantity
        return columns

    def definition(self, kind: str, name: str, value: Any) -> Any:
        """``[state.NAME]`` and the like; None for one that lacks what it needs."""
        here = Place((kind, name))
        self.declared_name(name, here)
        if kind in ("signal", "state", "phase"):
            tables = (("signal", SIGNALS), ("relation", RELATIONS))
            for taken in [word for word, table in tables if name in table][:1]:
                what = f'"{name}" is a built-in {taken}'
                self.report("R210", here.at_key, what, "another name")
        read = {
            "signal": self._signal,
            "state": self._state,
            "phase": self._phase,
            "goal": self.goal,
        }
        if kind in read:
            return read[kind](name, value, here)
        good = self.table(kind, value, here, Scope(""))
        return (ast.FamilyDef if kind == "family" else ast.TaskDef)(name, **good)

    def _state(self, name: str, value: Any, here: Place) -> ast.StateDef | None:
        scope = self._formals("state", name, value)
        good = self.table("state", value, here, scope)
        self.explain(good.get("explain", ""), here.inner("explain"), scope, ("time",))
        self._unused(scope, here.inner("of"))
        return _built(ast.StateDef, name, good, ("of", "when"))

    def _phase(self, name: str, value: Any, here: Place) -> ast.PhaseDef | None:
        scope = self._formals("phase", name, value)
        good = {"of": (), **self.table("phase", value, here, scope)}
        self._unused(scope, here.inner("of"))
        return _built(ast.PhaseDef, name, good, ("span",))

    def goal(self, name: str, value: Any, here: Place) -> ast.GoalDef | None:
        """``[goal.NAME]``, or one in a header or a bind file."""
        called = str(here.keys[-1])
        roles = value.get("roles", {}) if isinstance(value, dict) else {}
        scope = self.scope(("goal", called), f"goal {called}", roles, "goal")
        good = {"roles": (), **self.table("goal", value, here, scope)}
        self._unused(scope, here.inner("roles"))
        return _built(ast.GoalDef, name, good, ("require",))

    def _signal(self, name: str, value: Any, here: Place) -> ast.SignalDef | ast.DerivedDef | None:
        scope = self._formals("signal", name, value)
        table = self.table("signal", value, here, scope, skip=TABLES["signal"].keys() - {"of"})
        base = table.get("base")
        operations = [key for key in OPERATIONS if key in table]
        if operations and (base is not None or len(operations) > 1):
            what = f"signal {name} is said to be two things"
            allowed = f"base, or one of {', '.join(OPERATIONS)}"
            self.report("R205", here.inner(operations[-1], key=True), what, allowed)
        elif operations:
            return self._derived(name, operations[0], table, here, scope)
        elif base is None:
            what = f'[signal.{name}] needs "base", or an operation'
            allowed = f'base = "impact"; or one of {", ".join(OPERATIONS)} = [...]'
            self.report("R202", here.at_key, what, allowed)
        elif base not in SIGNALS:
            what = f'there is no built-in signal "{base}"'
            self.report("R401", here.inner("base"), what, ", ".join(SIGNALS), near=(base, SIGNALS))
        else:
            self.scope(("signal", name), f"signal {name}")
            return self._variant(name, base, table, here)
        return None

    def _derived(
        self, name: str, operation: Operation, table: dict[str, Any], here: Place, scope: Scope
    ) -> ast.DerivedDef | None:
        """A signal that is computed from others."""
        at, spec, given = here.inner(operation), OPERATIONS[operation], operands_of(table)
        options = ["over"] if spec.over else []
        for key in table.keys() - {"of", operation, *options}:
            what = f'a signal that is computed by {operation} has no option "{key}"'
            allowed = f"of, {', '.join([operation, *options])}"
            self.report("R414", here.inner(key, key=True), what, allowed)
        over = None
        if "over" in table and spec.over:
            over = self.lasting(table["over"], here.inner("over"), scope)
        if not spec.least <= len(given) <= spec.most:
            takes = "one signal" if spec.most == 1 else f"{spec.least} to {spec.most} operands"
            takes = "two operands" if spec.least == spec.most == 2 else takes
            what = f"{operation} takes {takes}, not {len(given)}"
            self.report("R416", at, what, spec.meaning)
        read = self.state_operand if spec.of_state else self.operand
        listed = isinstance(table[operation], list)
        nodes = [read(v, at.inner(i) if listed else at, scope) for i, v in enumerate(given)]
        measured = any(isinstance(node, ast.SignalAtom) for node in nodes)
        if given and not measured and not spec.of_state:
            self.report("R416", at, "constants alone are no signal", "at least one signal")
        self._unused(scope, here.inner("of"))
        signal = self.names.signal(name)
        if signal is None and measured and spec.least <= len(given) <= spec.most:
            dimensions = [self.names.operand_dimension(one) for one in given]
            try:
                if None not in dimensions:
                    dimension_of_result(operation, [str(one) for one in dimensions])
            except DimensionError as error:
                self.report("R407", at, error.what, error.allowed)
        operands = tuple(node for node in nodes if node is not None)
        if signal is None:
            return None
        return ast.DerivedDef(
            name, table.get("of", ()), operation, operands, signal.dimension, over
        )

    def _variant(
        self, name: str, base: str, table: dict[str, Any], here: Place
    ) -> ast.SignalDef | None:
        """A built-in signal with options of its own."""
        scope, before = self.scopes["signal", name], len(self.problems)
        options = {option.name: option for option in SIGNALS[base].options}
        for key in table.keys() - {"base"}:
            at, option = here.inner(key), options.get(key)
            if option is None:
                what, allowed = (
                    f'{base}() has no option "{key}"',
                    ", ".join(options) or "base alone",
                )
                self.report("R414", at.at_key, what, allowed, near=(key, options))
                continue
            value = self.parsed("R414", at, partial(read_option, option), table[key])
            self.timed(value if isinstance(value, ast.Parameter) else None, at, scope)
        for option in options.values():
            if option.required and option.name not in table:
                what = f'{base}() needs "{option.name}"'
                self.report("R414", here.at_key, what, option.meaning)
        sound = len(self.problems) == before
        return ast.SignalDef(name, base, read_options(table)) if sound else None

    # ---- rules and costs

    def judged(self, kind: str, value: Any, here: Place) -> ast.Scoped | None:
        """One ``[[rule]]`` or ``[[cost]]``; None for one that lacks what it needs."""
        given = value if isinstance(value, dict) else {}
        code = given.get("code")
        sound = isinstance(code, str) and re.fullmatch(CODE, code)
        read = (kind, str(code) if sound else f"#{here.keys[-1]}")
        roles = given.get("roles", {})
        scope = self.scope(read, str(code) if sound else f"this {kind}", roles, kind)
        good = self.table(kind, value, here, scope)
        for other in ("during", "until"):
            if "at" in given and other in given:
                what = f'"at" and "{other}" do not go together: "at" judges single frames'
                self.report("R205", here.inner(other, key=True), what, f'"at", or "{other}"')
        if kind == "rule":
            self._obligations(given, here, scope.label)
        elif "examples" in given and "budget" not in given:
            what = "a cost without a budget has no verdict that its examples could have"
            self.report("R205", here.inner("examples", key=True), what, "budget, or no examples")
        self.explain(good.get("explain", ""), here.inner("explain"), scope, WORDS)
        self._unused(scope, here.inner("roles"))
        if any(key.required and name not in good for name, key in TABLES[kind].items()):
            return None
        examples = good.pop("examples", {})
        line = self.file.locations.key(here.keys).line
        node: ast.Scoped = (ast.Rule if kind == "rule" else ast.Cost)(
            **{"roles": (), **_fields(good)}, **examples, path=self.file.path, line=line
        )
        return node

    def _obligations(self, given: dict[str, Any], here: Place, label: str) -> None:
        if not CLAUSES.keys() & given.keys():
            allowed = f"{_either(CLAUSES)}, or several of them"
            self.report("R202", here.at_key, f"{label} asks for nothing", allowed)
        lasting = _either(clause.kind for clause in CLAUSES.values() if clause.lasts)
        for kind, clause in CLAUSES.items():
            if kind in given and "for" in given and not clause.lasts:
                self.report(
                    "R208", here.inner("for", key=True), f'"for" does not apply to "{kind}", which '
                    "every frame must meet", f"for with {lasting}",
                    'forbid the opposite "for" that long, in a rule of its own',
                )  # fmt: skip


def _fields(good: dict[str, Any]) -> dict[str, Any]:
    """Keys as fields of the syntax tree."""
    return {"for_" if key == "for" else key: node for key, node in good.items()}


def _built(declared: Any, name: str, good: dict[str, Any], needed: tuple[str, ...]) -> Any:
    """A definition of what its table holds; None where it lacks what it needs."""
    return declared(name, **_fields(good)) if good.keys() >= {*needed} else None


def _either(names: Iterable[str]) -> str:
    """``require, forbid or reach``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


DEFINITIONS = ("param", "material", *NAMED)
"""The tables whose entries are named, may be used by other files and may be overridden."""
