"""Roles, formal arguments and parameter values: what every definition and rule may declare."""

from __future__ import annotations

from typing import Any

from . import parse, structure
from .keys import TABLES
from .locate import Keys
from .names import Near, unfit
from .references import Read, Scope
from .usage import Usage


class Declarations:
    """Checks declarations of one file; remembers what each definition uses.

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
            spec = self.usage.parsed("R305", at, parse.role, text)
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
        structure.declared_name(self.usage, name, keys)
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
