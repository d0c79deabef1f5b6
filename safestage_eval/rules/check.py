"""Everything that is wrong with rule files, all at once, before any of them is used."""

from __future__ import annotations

import string
from collections.abc import Iterable, Sequence
from typing import Any

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals.vocabulary import SIGNALS

from . import parse, structure
from . import syntax as ast
from .coherence import Coherence
from .diagnostic import Diagnostic
from .files import RuleFile
from .keys import NAMED, REPEATED, TABLES, TOP
from .locate import Keys
from .names import Names, nearest, unfit
from .usage import Read, Scope, Usage

_WORDS = ("signal", "value", "limit", "margin", "time", "t.worst", "t.first")
"""What ``explain`` may mention besides roles and ``t.STATE``."""


def check(files: Sequence[RuleFile]) -> list[Diagnostic]:
    """All problems of files that were read together, in the order of files and lines."""
    names = Names.of_table(file.table for file in files)
    problems: list[Diagnostic] = []
    scopes: dict[Read, tuple[Usage, Scope]] = {}
    for file in files:
        checker = _FileChecker(Usage(file, names, problems))
        checker.run()
        scopes.update({read: (checker.usage, scope) for read, scope in checker.scopes.items()})
    Coherence(files, scopes, problems).run()
    return sorted(set(problems))


def check_goal(names: Names, table: Any, path: str) -> list[Diagnostic]:
    """All problems of one goal table that stands in a trace's header instead of a rule file."""
    problems: list[Diagnostic] = []
    file = RuleFile(path, "", {}, asked=True)
    _FileChecker(Usage(file, names, problems)).goal(("goal",), table)
    return sorted(set(problems))


class _FileChecker:
    """Walks the tables of one file; remembers what each definition uses."""

    def __init__(self, usage: Usage) -> None:
        self.usage = usage
        self.scopes: dict[Read, Scope] = {}

    def run(self) -> None:
        usage, table = self.usage, self.usage.file.table
        for name, value in table.items():
            if name not in TOP:
                usage.report(
                    "R201", (name,), f'a rule file has no table "{name}"', ", ".join(TOP),
                    nearest(name, TOP), key=True,
                )  # fmt: skip
            elif name in REPEATED:
                if not isinstance(value, list):
                    usage.report(
                        "R203",
                        (name,),
                        f"[{name}] is repeated, one for each",
                        f"[[{name}]]",
                        key=True,
                    )
            elif not isinstance(value, dict):
                usage.report("R203", (name,), f'"{name}" must be a table', f"[{name}]", key=True)
        if "ruleset" not in table:
            usage.report(
                "R202", (), "the file does not say that it is a rule file",
                '[ruleset] format = 1, name = "…", version = "1.0.0"', "begin it with [ruleset]",
            )  # fmt: skip
        else:
            structure.table(usage, "ruleset", table["ruleset"], ("ruleset",))
        if "baseline" in table:
            self._baseline(table["baseline"])
        for name, value in _entries(table, "param"):
            structure.declared_name(usage, name, ("param", name))
            usage.value_of(value, ("param", name))
        self._materials(_entries(table, "material"))
        for kind in NAMED:
            for name, value in _entries(table, kind):
                self._named(kind, name, value)
        for kind in REPEATED:
            if usage.file.asked and isinstance(table.get(kind), list):
                for index, value in enumerate(table[kind]):
                    self._rule(kind, value, (kind, index))

    # ---- definitions

    def _baseline(self, table: Any) -> None:
        keys: Keys = ("baseline", "span")
        found = structure.table(self.usage, "baseline", table, ("baseline",))
        if "span" not in found:
            return
        scope = self._scope(("baseline", ""), "[baseline]", ())
        self.usage.span(found["span"], keys, scope)
        span = self.usage.parsed("R304", keys, parse.span, found["span"])
        if span is not None and not (
            isinstance(span, ast.Part) and span.which == "first" and isinstance(span.of, ast.Whole)
        ):
            self.usage.report(
                "R304", keys, "the baseline is the first frames of the episode",
                '"first 5 frames of episode", "first 0.1 s of episode"',
            )  # fmt: skip

    def _materials(self, rows: Iterable[tuple[str, Any]]) -> None:
        for name, row in rows:
            keys: Keys = ("material", name)
            structure.declared_name(self.usage, name, keys)
            if not isinstance(row, dict):
                self.usage.report(
                    "R203", keys, "a material is a table of columns", "[material.bottle]"
                )
                continue
            for column, value in row.items():
                at = (*keys, column)
                structure.declared_name(self.usage, column, at)
                found = self.usage.value_of(value, at)
                if isinstance(found, ast.Duration):
                    self.usage.report("R407", at, "a column holds quantities, not durations")

    def _named(self, kind: str, name: str, value: Any) -> None:
        keys: Keys = (kind, name)
        structure.declared_name(self.usage, name, keys)
        if kind in ("signal", "state", "phase"):
            taken = [
                k for k, known in (("signal", SIGNALS), ("relation", RELATIONS)) if name in known
            ]
            if taken:
                self.usage.report(
                    "R210", keys, f'"{name}" is a built-in {taken[0]}', "another name", key=True
                )
        if kind == "goal":
            self.goal(keys, value)
            return
        good = structure.table(self.usage, kind, value, keys)
        match kind:
            case "signal":
                self._signal(good, keys)
            case "state":
                self._state(name, good, keys)
            case "phase":
                self._phase(name, good, keys)
            case "family":
                self._assigned(good, keys)
            case "task":
                self._task(good, keys)

    def _signal(self, table: dict[str, Any], keys: Keys) -> None:
        base = table.get("base")
        if base is not None and base not in SIGNALS:
            self.usage.report(
                "R401", (*keys, "base"), f'there is no built-in signal "{base}"',
                ", ".join(SIGNALS), nearest(base, SIGNALS),
            )  # fmt: skip

    def _state(self, name: str, table: dict[str, Any], keys: Keys) -> None:
        scope = self._formals("state", name, table, keys)
        for key in ("when", "fallback"):
            if key in table:
                self.usage.condition(table[key], (*keys, key), scope)
        for key in ("for", "gap"):
            if key in table:
                self.usage.lasting(table[key], (*keys, key), scope)
        if "until" in table:
            self.usage.event(table["until"], (*keys, "until"), scope)
        self._unused(scope, (*keys, "of"))

    def _phase(self, name: str, table: dict[str, Any], keys: Keys) -> None:
        scope = self._formals("phase", name, table, keys)
        for key in ("span", "fallback"):
            if key in table:
                self.usage.span(table[key], (*keys, key), scope)
        self._unused(scope, (*keys, "of"))

    def goal(self, keys: Keys, value: Any) -> None:
        """``[goal.NAME]``."""
        table = structure.table(self.usage, "goal", value, keys)
        read = ("goal", str(keys[-1]))
        scope = self._roles(read, f"goal {keys[-1]}", table, keys, tuple(TABLES["goal"]))
        if "require" in table:
            self.usage.condition(table["require"], (*keys, "require"), scope)
        if "for" in table:
            self.usage.lasting(table["for"], (*keys, "for"), scope)
        self._unused(scope, (*keys, "roles"))

    def _task(self, table: dict[str, Any], keys: Keys) -> None:
        self._assigned(table, keys)
        known = {"family": self.usage.names.families, "goal": self.usage.names.goals}
        for key, among in known.items():
            if key in table and table[key] not in among:
                self.usage.report(
                    "R401", (*keys, key), f'there is no {key} "{table[key]}"',
                    ", ".join(sorted(among)) or f"a [{key}.NAME] of this file or one it extends",
                    nearest(table[key], among),
                )  # fmt: skip
        for role, players in table.get("roles", {}).items():
            bodies = players if isinstance(players, list) else [players]
            if not bodies or not all(isinstance(body, str) for body in bodies):
                self.usage.report(
                    "R203", (*keys, "roles", role), "a role is played by one body or a list of them",
                    '"mug", ["vase", "phone"]',
                )  # fmt: skip

    def _assigned(self, table: dict[str, Any], keys: Keys) -> None:
        for index, code in enumerate(table.get("rules", ())):
            if code not in self.usage.names.rules:
                self.usage.report(
                    "R401", (*keys, "rules", index), f'there is no rule "{code}"',
                    ", ".join(sorted(self.usage.names.rules)) or "codes of rules",
                    nearest(code, self.usage.names.rules),
                )  # fmt: skip
        self._settings(table.get("set", {}), (*keys, "set"))

    def _settings(self, values: Any, keys: Keys) -> None:
        if not isinstance(values, dict):
            self.usage.report(
                "R203", keys, "parameter values stand in a table", '{ edge = "3 cm" }'
            )
            return
        for name, value in values.items():
            self.usage.setting(name, value, (*keys, name))

    # ---- rules and costs

    def _rule(self, kind: str, value: Any, keys: Keys) -> None:
        usage = self.usage
        table = structure.table(usage, kind, value, keys)
        code = table.get("code", f"this {kind}")
        read = (kind, code if "code" in table else f"#{keys[-1]}")
        scope = self._roles(read, code, table, keys, tuple(TABLES[kind]))
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
        self._settings(table.get("set", {}), (*keys, "set"))
        for level, values in table.get("severity", {}).items():
            structure.declared_name(usage, level, (*keys, "severity", level))
            self._settings(values, (*keys, "severity", level))
        structure.table(usage, "examples", table.get("examples", {}), (*keys, "examples"))
        self._explain(table.get("explain", ""), (*keys, "explain"), scope)
        self._unused(scope, (*keys, "roles"))

    def _obligations(self, table: dict[str, Any], keys: Keys, scope: Scope, code: str) -> None:
        usage = self.usage
        if not {"require", "forbid", "reach"} & set(self._written(keys)):
            usage.report(
                "R202", keys, f"{code} asks for nothing",
                "require, forbid or reach, or several of them", key=True,
            )  # fmt: skip
        if "require" in table:
            usage.condition(table["require"], (*keys, "require"), scope)
        forbid = table.get("forbid", [])
        if isinstance(forbid, dict) and len(forbid) > 1:
            usage.report(
                "R206", (*keys, "forbid"), "a table means all of its entries at once; forbidding two "
                "things is a list", '[{ "a(x)" = true }, { "b(x)" = true }]',
                "put each entry into its own table in a list; if all at once is meant, a list of "
                "this one table", key=True,
            )  # fmt: skip
        if isinstance(forbid, list):
            for index, item in enumerate(forbid):
                usage.alternative(item, (*keys, "forbid", index), scope)
            if not forbid and "forbid" in table:
                usage.report("R203", (*keys, "forbid"), "an empty list forbids nothing")
        else:
            usage.alternative(forbid, (*keys, "forbid"), scope)
        if "reach" in table:
            usage.alternative(table["reach"], (*keys, "reach"), scope)
        if "for" in table:
            usage.lasting(table["for"], (*keys, "for"), scope)
            if "require" in table:
                usage.report(
                    "R208", (*keys, "for"), '"for" does not apply to "require", which every frame '
                    "must meet", "for with forbid or reach", 'forbid the opposite "for" that long, '
                    "in a rule of its own", key=True,
                )  # fmt: skip

    def _charge(self, value: Any, keys: Keys, scope: Scope) -> None:
        usage = self.usage
        table = structure.table(usage, "charge", value, keys)
        if isinstance(value, dict) and ("when" in value) == ("of" in value):
            usage.report("R205", keys, 'a charge has either "when" or "of"', "one of the two")
        if "above" in table and "when" in table:
            usage.report("R205", (*keys, "above"), '"above" goes with "of" only', key=True)
        if "when" in table:
            usage.alternative(table["when"], (*keys, "when"), scope)
        if "of" in table:
            call = usage.parsed("R307", (*keys, "of"), parse.call, table["of"])
            if call is not None:
                if usage.call(call, (*keys, "of"), scope) == "state":
                    usage.report(
                        "R404", (*keys, "of"), f"{call.name}() is a state", "a signal, or: when"
                    )
                elif "above" in table:
                    usage.above(call, table["above"], (*keys, "above"), scope)
            if table.get("per") == "start":
                usage.report("R205", (*keys, "per"), "a signal has no starts", '"second" or "step"')

    def _explain(self, text: str, keys: Keys, scope: Scope) -> None:
        try:
            fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        except ValueError as error:
            self.usage.report(
                "R209", keys, f"the braces of explain do not match: {error}", "{name}"
            )
            return
        states = [f"t.{name}" for name in sorted(scope.calls) if self.usage.names.is_state(name)]
        allowed = [*scope.roles, *_WORDS, *states]
        for name in fields:
            if name not in allowed:
                self.usage.report(
                    "R209", keys, f"explain does not know {{{name}}}",
                    ", ".join(f"{{{word}}}" for word in allowed), nearest(name, allowed),
                )  # fmt: skip

    # ---- roles

    def _roles(
        self, read: Read, label: str, table: dict[str, Any], keys: Keys, siblings: tuple[str, ...]
    ) -> Scope:
        roles: dict[str, Any] = table.get("roles", {})
        scope = self._scope(read, label, tuple(roles), siblings)
        scope.counting = True
        for name, text in roles.items():
            at = (*keys, "roles", name)
            self._role_name(name, at)
            if not isinstance(text, str):
                self.usage.report("R203", at, "a role is said in text", '"object", "every object"')
                continue
            spec = self.usage.parsed("R305", at, parse.role, text)
            for other in spec.excluding if spec is not None else ():
                scope.used.add(other)
                if other not in roles or other == name:
                    self.usage.report(
                        "R403", at, f'"{other}" is not another role of {label}',
                        ", ".join(role for role in roles if role != name), nearest(other, roles),
                    )  # fmt: skip
        return scope

    def _formals(self, kind: str, name: str, table: dict[str, Any], keys: Keys) -> Scope:
        formals = tuple(table.get("of", ()))
        for index, formal in enumerate(formals):
            self._role_name(formal, (*keys, "of", index))
            if formal in formals[:index]:
                self.usage.report("R210", (*keys, "of", index), f'"{formal}" stands here twice')
        return self._scope((kind, name), f"{kind} {name}", formals, tuple(TABLES[kind]))

    def _role_name(self, name: str, keys: Keys) -> None:
        structure.declared_name(self.usage, name, keys)
        why = unfit(name)
        if why and not why.startswith("is a word"):
            self.usage.report(
                "R210", keys, f'"{name}" {why}, so it cannot name a role', "another name", key=True
            )

    def _scope(
        self, read: Read, label: str, roles: tuple[str, ...], siblings: tuple[str, ...] = ()
    ) -> Scope:
        scope = Scope(label, roles, siblings=siblings)
        self.scopes[read] = scope
        return scope

    def _unused(self, scope: Scope, keys: Keys) -> None:
        for index, role in enumerate(scope.roles):
            if role not in scope.used:
                at = (*keys, index) if keys[-1] == "of" else (*keys, role)
                self.usage.report(
                    "R411", at, f'"{role}" is a role of {scope.label}, but nothing in it names it',
                    fix="use it or leave it out", key=True,
                )  # fmt: skip

    def _written(self, keys: Keys) -> dict[str, Any]:
        found: Any = self.usage.file.table
        for key in keys:
            found = found[key]
        return found if isinstance(found, dict) else {}


def _entries(table: dict[str, Any], kind: str) -> list[tuple[str, Any]]:
    found = table.get(kind)
    return list(found.items()) if isinstance(found, dict) else []
