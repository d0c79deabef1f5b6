"""The signals, relations, definitions and parameters that a rule uses, and where each value is from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS

from . import syntax as ast
from .check import definitions
from .digest import reached
from .files import RuleFile, read_files


@dataclass(frozen=True)
class Uses:
    """Everything that a rule reaches, directly or through what it names.

    Attributes:
        signals, relations: built-in names, sorted.
        states, phases: declared names, in the order in which they are reached.
        declared: declared signals, variants of built-in ones and computed ones.
        params: parameter → the value that holds.
        columns: material columns.
        needs: what a trace must hold (poses, geometry, forces, …), sorted.
    """

    signals: tuple[str, ...]
    relations: tuple[str, ...]
    states: tuple[str, ...]
    phases: tuple[str, ...]
    params: dict[str, ast.Setting]
    columns: tuple[str, ...]
    needs: tuple[str, ...]
    declared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Source:
    """Where a definition stands, what its author wrote beside it, and what it overrides, if it does."""

    path: str
    line: int
    comment: str
    was: str = ""


def own_params(rules: ast.RuleSet, rule: ast.Scoped) -> dict[str, ast.Setting]:
    """The parameter values of a rule where no episode says otherwise."""
    return {**rules.params, **dict(rule.set)}


def uses_of(rules: ast.RuleSet, node: Any, params: ast.Params) -> Uses:
    """The definitions that a rule, state, phase or condition uses."""
    uses = reached(rules, node, params)
    names: dict[str, list[str]] = {}
    for name in uses:
        kind, _, rest = name.partition(".")
        names.setdefault(kind, []).append(rest)
    called = {call.name for part in (node, *uses.values()) for call in calls(part)}
    variants = [name for name in names.get("signal", ()) if name in rules.signals]
    called |= {rules.signals[name].base for name in variants}
    signals, relations = sorted(called & set(SIGNALS)), sorted(called & set(RELATIONS))
    needs = {need for name in signals for need in SIGNALS[name].needs}
    needs |= {need for name in relations for need in RELATIONS[name].needs}
    return Uses(
        tuple(signals),
        tuple(relations),
        tuple(names.get("state", ())),
        tuple(names.get("phase", ())),
        {name: params[name] for name in names.get("param", ())},
        tuple(names.get("material", ())),
        tuple(sorted(needs)),
        tuple(names.get("signal", ())),
    )


def calls(node: Any) -> Iterator[ast.Call]:
    """Every call in a part of the syntax tree."""
    if isinstance(node, ast.Call):
        yield node
    elif is_dataclass(node):
        for item in fields(node):
            yield from calls(getattr(node, item.name))
    elif isinstance(node, tuple):
        for item in node:
            yield from calls(item)


def sources(specs: Sequence[str | Path]) -> dict[str, Source]:
    """``param.edge``, ``material.bottle.max_tilt``, ``state.moved`` → where it stands.

    Of several files that define a name, the last one that is read counts, as it does in the rules.
    """
    places: dict[str, Source] = {}
    values: dict[str, Any] = {}
    for file in read_files(specs)[0]:
        for name, value, keys in definitions(file):
            key, source = ".".join(name), _source(file, keys)
            if key in places and values[key] != value:
                before = places[key]
                source = replace(
                    source, was=f"{_was(values[key], value)} ({before.path}:{before.line})"
                )
            places[key], values[key] = source, value
    return places


def _was(old: Any, new: Any) -> str:
    """What one value, or the entries of one table, had been before another came in its place."""
    if not isinstance(old, dict) or not isinstance(new, dict):
        return f"was {_toml(old)}"
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    return "; ".join(
        f"{key} was {_toml(old[key])}" if key in old else f"{key} was not there" for key in changed
    )


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{k} = {_toml(v)}' for k, v in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _source(file: RuleFile, keys: tuple[str | int, ...]) -> Source:
    spot = file.locations.value(keys)
    rest = file.locations.line(spot.line)[spot.column - 1 + spot.length :]
    _, mark, comment = rest.partition("#")
    if not mark:
        return Source(file.path, spot.line, "")
    words = [comment.strip()]
    lines = file.text.splitlines()
    for line in lines[spot.line :]:  # a comment goes on in indented lines that hold nothing else
        if not line.startswith((" ", "\t")) or not line.strip().startswith("#"):
            break
        words.append(line.strip().removeprefix("#").strip())
    return Source(file.path, spot.line, " ".join(words))
