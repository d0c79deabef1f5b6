"""The combinations of bodies that a rule judges, and queries on its syntax tree."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from safestage_eval.rules import syntax as ast


def combinations(
    rule: ast.Scoped, players: Mapping[str, Sequence[str]], named: Sequence[str] | None = None
) -> Iterator[dict[str, str]]:
    """Every assignment of distinct bodies to the roles that are not merely counted over.

    ``named``: only these of the rule's roles; all if None.
    """
    free = [name for name in _taken_one_by_one(rule) if named is None or name in named]
    for bodies in itertools.product(*(players[name] for name in free)):
        if len(set(bodies)) == len(bodies):
            yield dict(zip(free, bodies, strict=True))


_MANY = 1024
_TAKEN: dict[int, tuple[ast.Scoped, tuple[str, ...], tuple[str, ...]]] = {}
"""By identity of a rule, which is kept, and so stays what it is: hashing one takes long."""


def _taken_one_by_one(rule: ast.Scoped) -> tuple[str, ...]:
    """The roles that are not merely counted over."""
    return _known(rule)[1]


def where_it_counts(rule: ast.Scoped) -> tuple[str, ...]:
    """The roles that the stretches of frames in which a rule is judged depend on."""
    return _known(rule)[2]


def _known(rule: ast.Scoped) -> tuple[ast.Scoped, tuple[str, ...], tuple[str, ...]]:
    known = _TAKEN.get(id(rule))
    if known is None:
        if len(_TAKEN) >= _MANY:
            _TAKEN.clear()
        parts = (rule.during, rule.at, rule.until)
        placed = tuple(n for n, _ in rule.roles if any(mentions(part, n) for part in parts))
        known = _TAKEN[id(rule)] = rule, _not_counted(rule), placed
    return known


def _not_counted(rule: ast.Scoped) -> tuple[str, ...]:
    counted = {node.role for node in nodes(rule) if isinstance(node, ast.CountAtom)}
    roles = [name for name, _ in rule.roles]
    return tuple(n for n in roles if n not in counted or named_outside_counts(rule, n))


def nodes(node: Any) -> Iterator[Any]:
    """Every dataclass inside a syntax tree, itself first."""
    if isinstance(node, tuple | list):
        for item in node:
            if not isinstance(item, str):
                yield from nodes(item)
    elif (names := field_names(type(node))) is not None:
        yield node
        for name in names:
            value = getattr(node, name)
            if value is not None and not isinstance(value, str):
                yield from nodes(value)


_FIELDS: dict[type, tuple[str, ...] | None] = {}


def field_names(kind: type) -> tuple[str, ...] | None:
    """Names of a dataclass's fields; None of any other type."""
    if kind not in _FIELDS:
        _FIELDS[kind] = tuple([f.name for f in fields(kind)]) if is_dataclass(kind) else None
    return _FIELDS[kind]


def mentions(node: Any, role: str) -> bool:
    """The role is named in a part of a syntax tree, other than as one that is counted over."""
    if isinstance(node, ast.CountAtom) and node.role == role:
        return False
    if isinstance(node, ast.Call):
        return role in node.args
    if isinstance(node, ast.Column):
        return node.role == role
    if isinstance(node, tuple | list):
        return any(mentions(item, role) for item in node if not isinstance(item, str))
    names = field_names(type(node)) or ()
    return any(mentions(getattr(node, name), role) for name in names if name != "roles")


def named_outside_counts(rule: ast.Scoped | ast.GoalDef, role: str) -> bool:
    """The role also stands outside ``at least K role``, so that its bodies are taken one by one."""
    return mentions(rule, role)
