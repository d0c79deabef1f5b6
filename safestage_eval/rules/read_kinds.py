"""The kinds of values that keys of a rule file hold: what TOML gives for each, and how it is read."""

from __future__ import annotations

import re
import string
from collections.abc import Iterable
from typing import Any, NamedTuple

from . import string_parser
from . import syntax as ast
from .names import RESERVED, unfit
from .read_values import Place, Scope, Values
from .table_keys import GONE, IN_BIND, REPEATED, TABLES

CODE = "[A-Z]{3}[0-9]{3}"
"""A rule's code: three letters for its stage or benchmark, three digits."""

FORMAT = 1
"""Version of the rule language that this SafeStage reads."""


class _Type(NamedTuple):
    """What TOML gives for a kind of key, an example, its reader where there is one, and its grammar where it has one."""

    types: type | tuple[type, ...]
    example: str
    read: str = ""
    production: str = ""


KINDS: dict[str, _Type] = {
    "text": _Type(str, "text in quotes"),
    "sentence": _Type(str, "text in quotes"),
    "axis": _Type((list, bool), "[0, 0, 1], or false where it has none", "axis"),
    "side": _Type(str, '"left" or "right"', "side"),
    "base": _Type(str, "the name of a built-in signal, in quotes"),
    "box": _Type(list, '[["-50 cm", "-1 m", "0 m"], ["1 m", "1 m", "1.5 m"]]'),
    "code": _Type(str, 'text in quotes: "ETS101"', "code"),
    "goal table": _Type((str, dict), "the name of a goal, or { roles = { … }, require = { … } }", "bound_goal"),
    "span": _Type(str, 'a span in quotes: "last 1 s of hold"', "span", "SPAN"),
    "event": _Type(str, 'an event in quotes: "success", "start of moved(target)"', "event", "EVENT"),
    "duration": _Type(str, 'a duration in quotes: "0.5 s", "3 frames @ 120 Hz"', "lasting", "DURATION"),
    "call": _Type(str, 'a signal in quotes: "contact_force(robot, protected)"', "signal_call", "CALL"),
    "operands": _Type((str, list), '["displacement(a)", "2 cm"], or one signal in quotes'),
    "flag": _Type(bool, "true or false", "flag"),
    "per": _Type(str, '"start", "second" or "step"', "per"),
    "condition": _Type(dict, '{ "moved(target)" = true }', "condition"),
    "alternative": _Type((str, dict), '"moved(target)" or { "speed(target)" = ">= 5 cm/s" }', "alternative"),
    "alternatives": _Type((str, dict, list), '"moved(target)", a condition, or a list of both', "alternatives"),
    "texts": _Type(list, '["…", "…"]', "texts"),
    "names": _Type(list, '["a", "b"]', "declared_names"),
    "codes": _Type(list, '["…", "…"]', "codes"),
    "charges": _Type(list, '[{ when = "…", add = 1, per = "start" }]', "charges"),
    "roles": _Type(dict, '{ target = "object" }', "roles", "ROLE"),
    "players": _Type(dict, '{ target = "mug", protected = ["vase", "phone"] }', "players"),
    "settings": _Type(dict, '{ edge = "3 cm" }', "settings"),
    "levels": _Type(dict, '{ serious = { edge = "1 cm" } }', "levels"),
    "examples": _Type(dict, '{ violates = ["…"], passes = ["…"] }', "examples"),
    "number": _Type((int, float), "a number", "number"),
    "format": _Type(int, f"{FORMAT}", "version"),
    "value": _Type((str, int, float), '"5 N", a parameter, or a number'),
    "budget": _Type((str, int, float), '"5 N", a parameter, or a number', "budget"),
}  # fmt: skip


class Kinds(Values):
    """Reads a table by the kinds of its keys."""

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
            self.stranger(f"{kind}.{name}", label, spec, here.inner(name, key=True))
        good = {}
        for name, key in spec.items():
            if name not in table:
                if key.required:
                    fix = f"{name} = {KINDS[key.kind].example}"
                    self.report("R202", here.at_key, f'{label} needs "{name}"', fix)
                continue
            at, value, (types, example, read, _) = here.inner(name), table[name], KINDS[key.kind]
            if (key.kind != "axis" and isinstance(value, bool) != (types is bool)) or not isinstance(value, types):  # fmt: skip
                self.report("R203", at, f'"{name}" has a value of the wrong type', example)
                continue
            node = getattr(self, read)(value, at, scope) if read and name not in skip else value
            if node is not None:
                good[name] = node
        return good

    def stranger(self, name: str, label: str, known: Iterable[str], here: Place) -> None:
        """A key or table that the language does not have, or has no more."""
        gone, word = GONE.get(name, ""), str(here.keys[-1])
        near = None if gone else (word, known)
        what = (
            f'{label} has no {"key" if "." in name else "table"} "{word}"{" any more" * bool(gone)}'
        )
        self.report("R201", here, what, ", ".join(known), gone, near=near)

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
        self.wrong(here, f'"{here.keys[-1]}" is no axis', KINDS["axis"].example)
        return None

    def side(self, value: str, here: Place, _: Scope) -> str | None:
        """Left or right."""
        if value in ("left", "right"):
            return value
        self.wrong(here, f'"{here.keys[-1]}" is no side', KINDS["side"].example)
        return None

    def code(self, value: str, here: Place, _: Scope) -> str | None:
        """The code of a rule."""
        if re.fullmatch(CODE, value):
            return value
        self.wrong(here, f'"{value}" is not a code', "three capital letters and three digits: ETS101")  # fmt: skip
        return None

    def per(self, value: str, here: Place, _: Scope) -> str | None:
        """What is charged for."""
        if value in ("start", "second", "step"):
            return value
        self.wrong(here, f'nothing can be charged per "{value}"', KINDS["per"].example)
        return None

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

    def codes(self, items: list[Any], here: Place, scope: Scope) -> tuple[str, ...]:
        """Codes of rules that need not be loaded."""
        codes = self.texts(items, here, scope)
        for index, code in enumerate(codes):
            self.code(code, here.inner(index), scope)
        return codes

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
        for limit in ("above", "below"):
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
