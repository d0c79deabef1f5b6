"""Checked TOML tables into the syntax tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from . import string_parser
from . import syntax as ast
from .clauses import CLAUSES, ClauseSpec
from .names import operands_of, operation_of
from .operations import OPERATIONS
from .table_keys import TABLES

Table = Mapping[str, Any]


class Builder:
    """Turns tables into syntax, given the names that are declared as phases.

    Raises ``string_parser.GrammarError`` for what is not in the grammar; ``check`` finds all such places
    beforehand, with their lines.
    """

    def __init__(self, phases: frozenset[str]) -> None:
        """``phases``: names under ``[phase]``, which distinguish them from states."""
        self._phases = phases

    def condition(self, table: Table) -> ast.Condition:
        """A table: all of its entries hold."""
        return ast.Condition(tuple(self._atom(key, value) for key, value in table.items()))

    def alternative(self, value: str | Table) -> ast.Alternative:
        """A string is an event, a table a condition."""
        return string_parser.event(value) if isinstance(value, str) else self.condition(value)

    def _atom(self, key: str, value: Any) -> ast.Atom:
        if key == "any":
            return ast.AnyOf(tuple(self.alternative(item) for item in value))
        of_states = string_parser.of_states(key)
        if of_states is not None:
            return replace(of_states, want=of_states.want == value)
        call, since = string_parser.atom_key(key)
        if isinstance(value, bool):
            return ast.StateAtom(call, value)
        if isinstance(value, str) and (counted := string_parser.count(value)):
            return ast.CountAtom(call, *counted)
        limits = value if isinstance(value, list) else [value]
        return ast.SignalAtom(call, tuple(string_parser.limit(item) for item in limits), since)

    def span(self, text: str) -> ast.Span:
        """A span, with phases recognised."""
        return self._resolved(string_parser.span(text))

    def _resolved(self, span: ast.Span) -> ast.Span:
        match span:
            case ast.StateSpan(call) if call.name in self._phases:
                return ast.PhaseSpan(call)
            case ast.Part(which, duration, of):
                return ast.Part(which, duration, self._resolved(of))
            case ast.While(of, call):
                return ast.While(self._resolved(of), call)
        return span

    def state(self, name: str, table: Table) -> ast.StateDef:
        """``[state.NAME]``."""
        return ast.StateDef(
            name,
            tuple(table["of"]),
            self.condition(table["when"]),
            _duration(table, "for"),
            _duration(table, "gap"),
            string_parser.event(table["until"]) if "until" in table else None,
            self.condition(table["fallback"]) if "fallback" in table else None,
            self.condition(table["perhaps"]) if "perhaps" in table else None,
            table.get("explain", ""),
            self.condition(table["also"]) if "also" in table else None,
        )

    def phase(self, name: str, table: Table) -> ast.PhaseDef:
        """``[phase.NAME]``."""
        fallback = self.span(table["fallback"]) if "fallback" in table else None
        return ast.PhaseDef(name, tuple(table.get("of", ())), self.span(table["span"]), fallback)

    def goal(self, name: str, table: Table) -> ast.GoalDef:
        """``[goal.NAME]``, or the goal table in a trace's header."""
        return ast.GoalDef(
            name, _roles(table), self.condition(table["require"]), _duration(table, "for")
        )

    def rule(self, table: Table, path: str, line: int) -> ast.Rule:
        """``[[rule]]``."""
        clauses = {
            kind: self._obligation(clause, table[kind])
            for kind, clause in CLAUSES.items()
            if kind in table
        }
        return ast.Rule(**self._shared(table, path, line), **clauses, for_=_duration(table, "for"))

    def cost(self, table: Table, path: str, line: int) -> ast.Cost:
        """``[[cost]]``."""
        return ast.Cost(
            **self._shared(table, path, line),
            charge=tuple(self._charge(item) for item in table["charge"]),
            budget=string_parser.limit(f"<= {table['budget']}").value
            if "budget" in table
            else None,
        )

    def _shared(self, table: Table, path: str, line: int) -> dict[str, Any]:
        """The fields that rules and costs share."""
        levels = table.get("severity", {})
        examples = table.get("examples", {})
        return {
            "code": table["code"],
            "title": table["title"],
            "roles": _roles(table),
            "given": self.condition(table["given"]) if "given" in table else None,
            "during": self.span(table["during"]) if "during" in table else None,
            "at": string_parser.event(table["at"]) if "at" in table else None,
            "until": string_parser.event(table["until"]) if "until" in table else None,
            "severity": tuple((name, settings(values)) for name, values in levels.items()),
            "set": settings(table.get("set", {})),
            "why": table.get("why", ""),
            "source": table.get("source", ""),
            "explain": table.get("explain", ""),
            **{kind: tuple(examples.get(kind, ())) for kind in TABLES["examples"]},
            "path": path,
            "line": line,
        }

    def _obligation(self, clause: ClauseSpec, value: Any) -> Any:
        """The value of a rule's field for one kind of obligation."""
        if clause.value == "condition":
            return self.condition(value)
        if clause.value == "alternative":
            return self.alternative(value)
        items = value if isinstance(value, list | tuple) else [value]
        return tuple([self.alternative(item) for item in items])

    def _charge(self, table: Table) -> ast.Charge:
        return ast.Charge(
            float(table["add"]),
            table["per"],
            self.alternative(table["when"]) if "when" in table else None,
            string_parser.call(table["of"]) if "of" in table else None,
            _value(table, "above"),
            _value(table, "below"),
            table.get("whole") or None,
        )


def derived(name: str, table: Table, dimension: str) -> ast.DerivedDef:
    """``[signal.NAME]`` with an operation, and the dimension that it comes to."""
    operation = operation_of(table)
    assert operation is not None
    given, of_state = operands_of(table), OPERATIONS[operation].of_state
    operands: tuple[ast.Operand, ...] = tuple(
        ast.StateAtom(string_parser.call(one), True) if of_state else string_parser.operand(one)
        for one in given
    )
    over = _duration(table, "over")
    return ast.DerivedDef(name, tuple(table.get("of", ())), operation, operands, dimension, over)


def family(name: str, table: Table) -> ast.FamilyDef:
    """``[family.X]``."""
    return ast.FamilyDef(name, tuple(table.get("rules", ())), settings(table.get("set", {})))


def task(name: str, table: Table) -> ast.TaskDef:
    """``[task.X]``, and each task of a bind file."""
    roles = tuple(
        (role, (players,) if isinstance(players, str) else tuple(players))
        for role, players in table.get("roles", {}).items()
    )
    return ast.TaskDef(
        name,
        table.get("family"),
        tuple(table.get("rules", ())),
        table.get("goal"),
        roles,
        settings(table.get("set", {})),
    )


def settings(table: Table) -> tuple[tuple[str, ast.Setting], ...]:
    """Parameter values, in the order written."""
    return tuple((name, string_parser.setting(value)) for name, value in table.items())


def _roles(table: Table) -> tuple[tuple[str, ast.RoleSpec], ...]:
    return tuple((name, string_parser.role(text)) for name, text in table.get("roles", {}).items())


def _value(table: Table, key: str) -> ast.Value | None:
    return string_parser.limit(f"> {table[key]}").value if key in table else None


def _duration(table: Table, key: str) -> ast.Duration | ast.Parameter | None:
    return string_parser.duration(table[key]) if key in table else None
