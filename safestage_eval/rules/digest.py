"""One number for the meaning of a rule: equal meanings hash alike, however they are written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from safestage_eval.signals import SIGNALS

from . import syntax as ast

BACKEND = "gjk"
"""The clearance engine whose answers a verdict rests on."""

Params = Mapping[str, ast.Quantity | ast.Duration]

_UNORDERED = {"atoms", "alternatives", "forbid", "limits", "roles", "excluding", "charge"}
"""Fields whose order says nothing."""
_LATER = {"perhaps", "also"}
"""Fields that came into the language later: where they are not used, a digest is what it was."""


def rule_digest(
    rules: ast.RuleSet, rule: ast.Scoped, params: Params, backend: str = BACKEND
) -> str:
    """SHA-256 (first 16 hex digits) of a rule as it holds under given parameter values.

    In SI to 12 digits, without prose; definitions, parameters and material columns count only if
    the rule reaches them, parameters with the values given here. 8 cm, 80 mm and 0.08 m hash
    alike; so do the entries of a condition in another order.

    Args:
        rules: where the definitions are.
        rule: one of its rules.
        params: name → value, as they hold for the rule and episode.
        backend: the clearance engine.
    """
    return digest_of(rules, rule, params, backend)


def digest_of(rules: ast.RuleSet, node: object, params: Params, backend: str = BACKEND) -> str:
    """As ``rule_digest``, of any part of a rule, or of a goal."""
    known = _known(rules, node)
    values = (backend, *[params[name] for name in known.reads])
    digest = known.digests.get(values)
    if digest is None:
        digest = known.digests[values] = _digest(rules, node, params, backend)
    return digest


def reached(
    rules: ast.RuleSet, node: Any, params: Params
) -> dict[str, ast.Quantity | ast.Duration | Any]:
    """Everything that a rule, goal or condition uses, directly or not: ``state.moved`` → definition.

    Parameters come with the values given; material columns as pairs of material and value.
    """
    return {
        name: params[value.name] if isinstance(value, ast.Parameter) else value
        for name, value in _known(rules, node).uses.items()
    }


def parameters_read(rules: ast.RuleSet, node: object) -> frozenset[str]:
    """Names of the parameters that a part of a rule reads, directly or not, whatever their values."""
    return _known(rules, node).reads


@dataclass(frozen=True)
class _Known:
    """What was found out about a part of a rule.

    Attributes:
        node: the part; kept, so that no other comes to have its identity.
        uses: as ``reached``, with the name of a parameter in place of its value.
        reads: names of the parameters among them.
        digests: backend and the values of these → digest.
    """

    node: object
    uses: dict[str, Any]
    reads: frozenset[str]
    digests: dict[tuple[Any, ...], str]


_MANY = 4096
"""Parts of rules that are remembered at once; goals in headers are new with every episode."""


def _known(rules: ast.RuleSet, node: object) -> _Known:
    """By identity: equal parts are hashed as often as they are asked about, and that takes long."""
    key = tuple(map(id, node)) if isinstance(node, tuple) else id(node)
    found: _Known | None = rules.known.get(("known", key))
    if found is not None:
        return found
    if len(rules.known) > _MANY:
        rules.known.clear()
    uses: dict[str, Any] = {}
    todo = [node]
    while todo:
        for name, value in _named(todo.pop(), rules):
            if name not in uses:
                uses[name] = value
                if not isinstance(value, ast.Parameter):
                    todo.append(value)
    reads = frozenset(v.name for v in uses.values() if isinstance(v, ast.Parameter))
    found = rules.known["known", key] = _Known(node, uses, reads, {})
    return found


def _digest(rules: ast.RuleSet, node: object, params: Params, backend: str) -> str:
    uses = reached(rules, node, params)
    body = [
        _plain(node),
        [[name, _plain(value)] for name, value in sorted(uses.items(), key=lambda item: item[0])],
        _plain(rules.baseline),
        backend,
    ]
    text = json.dumps(body, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _named(node: Any, rules: ast.RuleSet) -> Iterator[tuple[str, Any]]:
    """Definitions and parameters that a node names directly."""
    if isinstance(node, ast.Parameter):
        yield f"param.{node.name}", node
    elif isinstance(node, ast.Column):
        rows = sorted(rules.materials.items())
        yield (
            f"material.{node.name}",
            tuple((material, row[node.name]) for material, row in rows if node.name in row),
        )
    elif isinstance(node, ast.Call):
        for kind, table in (
            ("state", rules.states),
            ("phase", rules.phases),
            ("signal", rules.signals),
        ):
            if node.name in table:
                yield f"{kind}.{node.name}", table[node.name]
        variant = rules.signals.get(node.name)
        spec = SIGNALS.get(variant.base if variant is not None else node.name)
        if spec is not None:
            for column, _ in spec.columns:
                yield from _named(ast.Column(column, ""), rules)
            given = dict(variant.options) if variant is not None else {}
            for option in spec.params(given):
                if option.name in rules.params:
                    yield from _named(ast.Parameter(option.name), rules)
            usual = tuple(
                (o.name, o.default)
                for o in spec.options
                if o.default is not None and not (o.param and o.name in rules.params)
            )
            if usual and variant is None:
                yield f"usual.{spec.name}", usual
    if is_dataclass(node):
        for item in fields(node):
            if item.compare:
                yield from _named(getattr(node, item.name), rules)
    elif isinstance(node, tuple):
        for value in node:
            yield from _named(value, rules)


def _plain(node: Any) -> Any:
    if is_dataclass(node):
        plain: dict[str, Any] = {"": type(node).__name__}
        for item in fields(node):
            # prose is not compared; what a rule sets is in the parameter values already
            if not item.compare or item.name in ("title", "set"):
                continue
            value = _plain(getattr(node, item.name))
            if value is None and item.name in _LATER:
                continue
            plain[item.name] = sorted(value, key=json.dumps) if item.name in _UNORDERED else value
        return plain
    if isinstance(node, tuple):
        return [_plain(value) for value in node]
    return float(f"{node:.12g}") if isinstance(node, float) else node
