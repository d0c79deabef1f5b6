"""One number for the meaning of a rule: equal meanings hash alike, however they are written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from . import syntax as ast

BACKEND = "gjk"
"""The clearance engine whose answers a verdict rests on."""

_PROSE = {"title", "why", "explain", "violates", "passes", "path", "line", "text"}


def rule_digest(
    rules: ast.RuleSet,
    rule: ast.Rule,
    params: Mapping[str, ast.Quantity | ast.Duration],
    backend: str = BACKEND,
) -> str:
    """SHA-256 (first 16 hex digits) of a rule as it holds under given parameter values.

    In SI, without prose; definitions and parameters count only if the rule reaches them. 8 cm,
    80 mm and 0.08 m hash alike; so do the alternatives of ``forbid`` in another order.
    """
    reached: dict[str, Any] = {}
    todo: list[Any] = [rule]
    while todo:
        for name, value in _referenced(todo.pop(), rules, params):
            if name not in reached:
                reached[name] = _plain(value)
                todo.append(value)
    body = [_plain(rule), sorted(reached.items()), _plain(rules.baseline), backend]
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()[:16]


def _referenced(
    node: Any, rules: ast.RuleSet, params: Mapping[str, ast.Quantity | ast.Duration]
) -> list[tuple[str, Any]]:
    """Definitions and parameter values that a node names directly."""
    found: list[tuple[str, Any]] = []
    if isinstance(node, ast.Parameter):
        found.append((f"param.{node.name}", params[node.name]))
    elif isinstance(node, ast.Column):
        values = [(m, row[node.name]) for m, row in rules.materials.items() if node.name in row]
        found.append((f"material.{node.name}", tuple(sorted(values, key=lambda v: v[0]))))
    elif isinstance(node, ast.Call):
        for kind, table in (
            ("state", rules.states),
            ("phase", rules.phases),
            ("signal", rules.signals),
        ):
            if node.name in table:
                found.append((f"{kind}.{node.name}", table[node.name]))
    if is_dataclass(node):
        for item in fields(node):
            if item.name not in _PROSE:
                found += _referenced(getattr(node, item.name), rules, params)
    elif isinstance(node, tuple | list):
        for value in node:
            found += _referenced(value, rules, params)
    return found


def _plain(node: Any) -> Any:
    if isinstance(node, ast.Quantity):
        return [float(f"{node.value:.12g}"), node.dimension]
    if is_dataclass(node):
        plain = {
            item.name: _plain(getattr(node, item.name))
            for item in fields(node)
            if item.name not in _PROSE
        }
        if isinstance(node, ast.Rule):
            plain["forbid"] = sorted(plain["forbid"], key=json.dumps)
        if isinstance(node, ast.Condition):
            plain["atoms"] = sorted(plain["atoms"], key=json.dumps)
        if isinstance(node, ast.AnyOf):
            plain["alternatives"] = sorted(plain["alternatives"], key=json.dumps)
        return {"": type(node).__name__, **plain}
    if isinstance(node, tuple | list):
        return [_plain(value) for value in node]
    return float(f"{node:.12g}") if isinstance(node, float) else node
