"""Checks of rules and costs: obligations, charges, scopes and sentences."""

from __future__ import annotations

import string
from collections.abc import Iterable
from typing import Any

from . import string_parser, table_checks
from .clauses import CLAUSES
from .condition_checks import Usage
from .locate import Keys
from .names import Near, unfit
from .reference_checks import Read, Scope
from .table_keys import TABLES

WORDS = ("signal", "value", "limit", "margin", "time", "t.worst", "t.first")
"""Words that a rule's ``explain`` may use besides roles and states."""


class Obligations:
    """Checks ``[[rule]]`` and ``[[cost]]`` of one file, and the roles that definitions declare.

    Attributes:
        usage: checks the file's strings.
        scopes: definition or rule → what it uses.
    """

    def __init__(self, usage: Usage) -> None:
        self.usage = usage
        self.scopes: dict[Read, Scope] = {}

    def roles(
        self, read: Read, label: str, table: dict[str, Any], keys: Keys, siblings: tuple[str, ...]
    ) -> Scope:
        """The roles of a rule, cost or goal, ready to be used."""
        roles: dict[str, Any] = table.get("roles", {})
        scope = self.scope(read, label, tuple(roles), siblings)
        scope.counting = True
        for name, text in roles.items():
            at = (*keys, "roles", name)
            self._role_name(name, at)
            if not isinstance(text, str):
                self.usage.report("R203", at, "a role is said in text", '"object", "every object"')
                continue
            spec = self.usage.parsed("R305", at, string_parser.role, text)
            if spec is not None:
                scope.kinds[name] = spec.kind
            for other in spec.excluding if spec is not None else ():
                scope.used.add(other)
                if other not in roles or other == name:
                    self.usage.report(
                        "R403", at, f'"{other}" is not another role of {label}',
                        ", ".join(role for role in roles if role != name), Near(other, roles),
                    )  # fmt: skip
        return scope

    def formals(self, kind: str, name: str, table: dict[str, Any], keys: Keys) -> Scope:
        """The formal arguments of a state or phase, ready to be used."""
        formals = tuple(table.get("of", ()))
        for index, formal in enumerate(formals):
            self._role_name(formal, (*keys, "of", index))
            if formal in formals[:index]:
                self.usage.report("R210", (*keys, "of", index), f'"{formal}" stands here twice')
        return self.scope((kind, name), f"{kind} {name}", formals, tuple(TABLES[kind]))

    def _role_name(self, name: str, keys: Keys) -> None:
        table_checks.declared_name(self.usage, name, keys)
        why = unfit(name)
        if why and not why.startswith("is a word"):
            self.usage.report(
                "R210", keys, f'"{name}" {why}, so it cannot name a role', "another name", key=True
            )

    def scope(
        self, read: Read, label: str, roles: tuple[str, ...], siblings: tuple[str, ...] = ()
    ) -> Scope:
        """An empty scope for a definition, kept under its kind and name."""
        scope = Scope(label, roles, siblings=siblings)
        self.scopes[read] = scope
        return scope

    def unused(self, scope: Scope, keys: Keys) -> None:
        """Report the roles that nothing named."""
        for index, role in enumerate(scope.roles):
            if role not in scope.used:
                at = (*keys, index) if keys[-1] == "of" else (*keys, role)
                self.usage.report(
                    "R411", at, f'"{role}" is a role of {scope.label}, but nothing in it names it',
                    fix="use it or leave it out", key=True,
                )  # fmt: skip

    def settings(self, values: Any, keys: Keys) -> None:
        """A table of parameter values."""
        if not isinstance(values, dict):
            self.usage.report(
                "R203", keys, "parameter values stand in a table", '{ edge = "3 cm" }'
            )
            return
        for name, value in values.items():
            self.usage.setting(name, value, (*keys, name))

    def rule(self, kind: str, value: Any, keys: Keys) -> None:
        """One ``[[rule]]`` or ``[[cost]]``."""
        usage = self.usage
        table = table_checks.table(usage, kind, value, keys)
        code = table.get("code", f"this {kind}")
        read = (kind, code if "code" in table else f"#{keys[-1]}")
        scope = self.roles(read, code, table, keys, tuple(TABLES[kind]))
        if "given" in table:
            usage.condition(table["given"], (*keys, "given"), scope)
        if "during" in table:
            usage.span(table["during"], (*keys, "during"), scope)
        for key in ("at", "until"):
            if key in table:
                usage.event(table[key], (*keys, key), scope)
        for other in ("during", "until"):
            if "at" in table and other in table:
                usage.report(
                    "R205", (*keys, other), f'"at" and "{other}" do not go together: '
                    '"at" judges single frames', f'"at", or "{other}"', key=True,
                )  # fmt: skip
        if kind == "rule":
            self._obligations(table, keys, scope, code)
        else:
            for index, charge in enumerate(table.get("charge", ())):
                self._charge(charge, (*keys, "charge", index), scope)
            if not table.get("charge", True):
                usage.report("R203", (*keys, "charge"), "an empty list charges nothing")
            if "budget" in table:
                usage.budget(table["budget"], (*keys, "budget"), scope)
            elif "examples" in table:
                usage.report(
                    "R205", (*keys, "examples"), "a cost without a budget has no verdict that its "
                    "examples could have", "budget, or no examples", key=True,
                )  # fmt: skip
        self.settings(table.get("set", {}), (*keys, "set"))
        for level, values in table.get("severity", {}).items():
            table_checks.declared_name(usage, level, (*keys, "severity", level))
            self.settings(values, (*keys, "severity", level))
        table_checks.table(usage, "examples", table.get("examples", {}), (*keys, "examples"))
        self.explain(table.get("explain", ""), (*keys, "explain"), scope, WORDS)
        self.unused(scope, (*keys, "roles"))

    def _obligations(self, table: dict[str, Any], keys: Keys, scope: Scope, code: str) -> None:
        usage = self.usage
        if not CLAUSES.keys() & self._written(keys).keys():
            usage.report(
                "R202", keys, f"{code} asks for nothing",
                f"{_either(CLAUSES)}, or several of them", key=True,
            )  # fmt: skip
        for kind, clause in CLAUSES.items():
            if kind not in table:
                continue
            at = (*keys, kind)
            if clause.value == "condition":
                usage.condition(table[kind], at, scope)
            elif clause.value == "alternative":
                usage.alternative(table[kind], at, scope)
            else:
                self._alternatives(table[kind], at, scope)
            if "for" in table and not clause.lasts:
                lasting = [other.kind for other in CLAUSES.values() if other.lasts]
                usage.report(
                    "R208", (*keys, "for"), f'"for" does not apply to "{kind}", which every frame '
                    "must meet", f"for with {_either(lasting)}", 'forbid the opposite "for" that long, '
                    "in a rule of its own", key=True,
                )  # fmt: skip
        if "for" in table:
            usage.lasting(table["for"], (*keys, "for"), scope)

    def _alternatives(self, value: Any, keys: Keys, scope: Scope) -> None:
        """One thing that is forbidden, or a list of them."""
        usage = self.usage
        if isinstance(value, dict) and len(value) > 1:
            usage.report(
                "R206", keys, "a table means all of its entries at once; forbidding two "
                "things is a list", '[{ "a(x)" = true }, { "b(x)" = true }]',
                "put each entry into its own table in a list; if all at once is meant, a list of "
                "this one table", key=True,
            )  # fmt: skip
        if not isinstance(value, list):
            usage.alternative(value, keys, scope)
            return
        for index, item in enumerate(value):
            usage.alternative(item, (*keys, index), scope)
        if not value:
            usage.report("R203", keys, f"an empty list {keys[-1]}s nothing")

    def _charge(self, value: Any, keys: Keys, scope: Scope) -> None:
        usage = self.usage
        table = table_checks.table(usage, "charge", value, keys)
        if isinstance(value, dict) and ("when" in value) == ("of" in value):
            usage.report("R205", keys, 'a charge has either "when" or "of"', "one of the two")
        if table.get("add", 1) <= 0:
            usage.report("R203", (*keys, "add"), "a charge adds to the cost", "a number above 0")
        for limit in ("above", "below", "whole"):
            if limit in table and "when" in table:
                usage.report("R205", (*keys, limit), f'"{limit}" goes with "of" only', key=True)
        for other in ("above", "whole"):
            if "below" in table and other in table:
                usage.report(
                    "R205", (*keys, other), f'"{other}" and "below" do not go together: what is '
                    "charged is too much, or too little", f'"{other}" or "below"', key=True,
                )  # fmt: skip
        if "when" in table:
            usage.alternative(table["when"], (*keys, "when"), scope)
        if "of" in table:
            call = usage.parsed("R307", (*keys, "of"), string_parser.call, table["of"])
            if call is not None:
                if usage.call(call, (*keys, "of"), scope) == "state":
                    usage.report(
                        "R404", (*keys, "of"), f"{call.name}() is a state", "a signal, or: when"
                    )
                for limit in ("above", "below"):
                    if limit in table:
                        usage.above(call, table[limit], (*keys, limit), scope)

    def explain(self, text: str, keys: Keys, scope: Scope, words: tuple[str, ...]) -> None:
        """A sentence: it mentions roles, the given words, and when states begin."""
        try:
            fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        except ValueError as error:
            self.usage.report(
                "R209", keys, f"the braces of explain do not match: {error}", "{name}"
            )
            return
        states = [f"t.{name}" for name in sorted(scope.calls) if self.usage.names.is_state(name)]
        allowed = [*scope.roles, *words, *states]
        for name in fields:
            if name.startswith("next."):
                call = self.usage.parsed(
                    "R209", keys, string_parser.call, name.removeprefix("next.")
                )
                if call is not None and self.usage.call(call, keys, scope) == "signal":
                    self.usage.report(
                        "R209", keys, f"{call.name}() is a signal, and has no start", "a state"
                    )
            elif name not in allowed:
                self.usage.report(
                    "R209", keys, f"explain does not know {{{name}}}",
                    ", ".join(f"{{{word}}}" for word in allowed), Near(name, allowed),
                )  # fmt: skip

    def _written(self, keys: Keys) -> dict[str, Any]:
        entry: Any = self.usage.file.table
        for key in keys:
            entry = entry[key]
        return entry if isinstance(entry, dict) else {}


def _either(names: Iterable[str]) -> str:
    """``require, forbid or reach``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last
