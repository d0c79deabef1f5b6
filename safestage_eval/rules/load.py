"""Rule files in, one checked rule set out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from safestage_eval.evidence.declare import Signal

from . import string_parser, syntax_builder
from . import syntax as ast
from .check import check
from .diagnostic import Diagnostic, RuleErrors
from .files import RuleFile, read_files
from .names import Names, operation_of
from .signal_options import read_options

DEFINITIONS = ("param", "material", "signal", "state", "phase", "goal", "family", "task")
"""The tables whose entries are named, may be used by other files and may be overridden."""


def load_rules(specs: Sequence[str | Path]) -> ast.RuleSet:
    """Read, check and merge rule files.

    The files are read each time; as long as none of them changed, the same rule set comes back.

    Args:
        specs: paths of files or folders, or built-in names (``["fsh"]``, ``["rules/"]``).

    Raises:
        RuleErrors: with every diagnostic of every file at once.
        RuleError: a spec stands for no file, or a file cannot be opened.
    """
    files, problems = read_files(specs)
    if problems:
        raise RuleErrors(problems + check(files))
    return _load(tuple(files))


@lru_cache(maxsize=32)
def _load(files: tuple[RuleFile, ...]) -> ast.RuleSet:
    """Check and merge files that could be read. Raises RuleErrors."""
    problems = check(files)
    if problems:
        raise RuleErrors(problems)
    return merge(files)


def check_rules(specs: Sequence[str | Path]) -> list[Diagnostic]:
    """Everything that is wrong with rule files, in the order of files and lines; best empty.

    Args:
        specs: paths of files or folders, or built-in names.

    Raises:
        RuleError: a spec stands for no file, or a file cannot be opened.
    """
    files, problems = read_files(specs)
    return sorted(problems + check(files))


def merge(files: Sequence[RuleFile]) -> ast.RuleSet:
    """One rule set of checked files; a later definition of a name replaces an earlier one."""
    tables: dict[str, dict[str, Any]] = {kind: {} for kind in DEFINITIONS}
    baseline = "first 5 frames of episode"
    for file in files:
        for kind in DEFINITIONS:
            for name, value in file.table.get(kind, {}).items():
                before = tables[kind].get(name, {}) if kind == "material" else None
                tables[kind][name] = value if before is None else {**before, **value}
        baseline = file.table.get("baseline", {}).get("span", baseline)
    builder = syntax_builder.Builder(frozenset(tables["phase"]))
    named = [file for file in files if file.asked]
    computed = {n: t for n, t in tables["signal"].items() if operation_of(t) is not None}
    signals = Names.of_table(file.table for file in files).variants if computed else {}
    rules = [
        builder.rule(table, file.path, file.locations.key(("rule", index)).line)
        for file in named
        for index, table in enumerate(file.table.get("rule", ()))
    ]
    costs = [
        builder.cost(table, file.path, file.locations.key(("cost", index)).line)
        for file in named
        for index, table in enumerate(file.table.get("cost", ()))
    ]
    heads = [file.table["ruleset"] for file in named]
    return ast.RuleSet(
        name="+".join(head["name"] for head in heads),
        version="+".join(dict.fromkeys(str(head["version"]) for head in heads)),
        baseline=builder.span(baseline),
        params={name: string_parser.setting(value) for name, value in tables["param"].items()},
        materials={
            name: {column: string_parser.quantity(value) for column, value in row.items()}
            for name, row in {"default": {}, **tables["material"]}.items()
        },
        signals={
            name: ast.SignalDef(name, t["base"], read_options(t))
            for name, t in tables["signal"].items()
            if name not in computed
        },
        states={name: builder.state(name, t) for name, t in tables["state"].items()},
        phases={name: builder.phase(name, t) for name, t in tables["phase"].items()},
        goals={name: builder.goal(name, t) for name, t in tables["goal"].items()},
        families={name: syntax_builder.family(name, t) for name, t in tables["family"].items()},
        tasks={name: syntax_builder.task(name, t) for name, t in tables["task"].items()},
        rules={rule.code: rule for rule in rules},
        costs={cost.code: cost for cost in costs},
        derived={
            name: syntax_builder.derived(name, t, _dimension(signals[name]))
            for name, t in computed.items()
        },
    )


def _dimension(signal: Signal | None) -> str:
    """Dimension of a derived signal of checked files."""
    assert signal is not None
    return signal.dimension
