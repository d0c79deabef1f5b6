"""The combinations of bodies that a rule judges, and queries on its syntax tree."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

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


Found = TypeVar("Found")
Kept = dict[int, tuple[object, Found]]
"""What was found about parts of rules, by their identity: hashing one takes long."""

MANY = 4096
"""Parts of rules of which something is kept at once; goals in headers are new with every episode."""

_TAKEN: Kept[tuple[str, ...]] = {}
_PLACED: Kept[tuple[str, ...]] = {}


def kept(known: Kept[Found], part: object, find: Callable[[], Found]) -> Found:
    """What ``find`` finds about a part of the rules, found once; the part stays what it is, beside it."""
    found = known.get(id(part))
    if found is None or found[0] is not part:
        if len(known) > MANY:
            known.clear()
        found = known[id(part)] = part, find()
    return found[1]


def _taken_one_by_one(rule: ast.Scoped) -> tuple[str, ...]:
    return kept(_TAKEN, rule, lambda: taken_one_by_one(rule, rule))


def taken_one_by_one(rule: ast.Scoped | ast.GoalDef, part: object) -> tuple[str, ...]:
    """The roles that a part does not merely count over."""
    counted = {node.role for node in nodes(part) if isinstance(node, ast.CountAtom)}
    roles = [name for name, _ in rule.roles]
    return tuple(n for n in roles if n not in counted or mentions(rule, n))


def where_it_counts(rule: ast.Scoped) -> tuple[str, ...]:
    """The roles that the stretches of frames in which a rule is judged depend on."""
    parts = (rule.during, rule.at, rule.until)

    def placed() -> tuple[str, ...]:
        return tuple(n for n, _ in rule.roles if any(mentions(part, n) for part in parts))

    return kept(_PLACED, rule, placed)


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
