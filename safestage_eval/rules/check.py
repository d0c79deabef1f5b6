"""Rule files that were read together: every problem of them at once, and the rule set that they mean."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from . import string_parser
from . import syntax as ast
from .coherence_checks import Coherence
from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Names, table_of
from .read_tables import DEFINITIONS, Tables
from .read_values import Place, Read, Scope, Values
from .table_keys import NAMED, REPEATED


def check(files: Sequence[RuleFile]) -> list[Diagnostic]:
    """All problems of files that were read together, in the order of files and lines."""
    return read(files)[0]


def read(files: Sequence[RuleFile]) -> tuple[list[Diagnostic], ast.RuleSet]:
    """All problems, in the order of files and lines, and what the files mean together.

    A later definition of a name replaces an earlier one; what cannot be read is left out.
    """
    names = Names()
    problems: list[Diagnostic] = []
    heads: list[dict[str, Any]] = []
    scopes: dict[Read, tuple[Values, Scope]] = {}
    defined: dict[str, dict[str, Any]] = {kind: {} for kind in DEFINITIONS}
    judged: dict[str, dict[str, Any]] = {kind: {} for kind in REPEATED}
    readers = [Tables(file, names, problems) for file in files]
    rows: list[tuple[Tables, str, dict[str, ast.Quantity | None]]] = []
    for tables in readers:  # first what names stand for, then what uses them
        tables.strangers()
        head = tables.head()
        if tables.file.asked:
            heads.append(head)
        for name, value in table_of(tables.file.table, "param").items():
            defined["param"][name] = tables.param(name, value)
        for name, row in table_of(tables.file.table, "material").items():
            rows.append((tables, name, tables.material(name, row)))
        names.declare(tables.file.table)
    names.derive()
    default: dict[str, ast.Quantity | None] = {}
    for _, name, cells in rows:
        default = {**cells, **default} if name == "default" else default
    for tables, name, cells in rows:
        tables.columns(name, cells, default)
        known = {column: value for column, value in cells.items() if value is not None}
        defined["material"][name] = {**defined["material"].get(name, {}), **known}
    defined["material"].setdefault("default", {})
    baseline: ast.Span | None = string_parser.span("first 5 frames of episode")
    for tables in readers:
        file = tables.file
        if "baseline" in file.table:
            baseline = tables.baseline(file.table["baseline"])
        for kind in NAMED:
            for name, value in table_of(file.table, kind).items():
                defined[kind][name] = tables.definition(kind, name, value)
        for kind in REPEATED:
            listed = file.table.get(kind)
            for index, value in enumerate(
                listed if file.asked and isinstance(listed, list) else ()
            ):
                node = tables.judged(kind, value, Place((kind, index)))
                if node is not None:
                    judged[kind][node.code] = node
        scopes.update({read: (tables, scope) for read, scope in tables.scopes.items()})
    Coherence(files, scopes, problems).run()
    signals = defined["signal"].items()
    return sorted(set(problems)), ast.RuleSet(
        name="+".join(head.get("name", "") for head in heads),
        version="+".join(dict.fromkeys(head.get("version", "") for head in heads)),
        baseline=baseline or ast.Whole(),
        params=defined["param"],
        materials=defined["material"],
        signals={name: one for name, one in signals if isinstance(one, ast.SignalDef)},
        states=defined["state"],
        phases=defined["phase"],
        goals=defined["goal"],
        rules=judged["rule"],
        costs=judged["cost"],
        derived={name: one for name, one in signals if isinstance(one, ast.DerivedDef)},
    )


def read_goal(
    names: Names, table: Any, path: str, file: RuleFile | None = None, keys: Keys = ("goal",)
) -> tuple[list[Diagnostic], ast.GoalDef | None]:
    """All problems of one goal table that stands in a trace's header, and what it means if there is none.

    ``file`` and ``keys``: where it stands; nowhere that could be shown if None.
    """
    problems: list[Diagnostic] = []
    tables = Tables(file or RuleFile(path, "", {}, asked=True), names, problems)
    goal = tables.goal("header", table, Place(keys))
    return sorted(set(problems)), None if problems else goal


def check_goal(names: Names, table: Any, path: str) -> list[Diagnostic]:
    """All problems of one goal table that stands in a trace's header or a bind file."""
    return read_goal(names, table, path)[0]
