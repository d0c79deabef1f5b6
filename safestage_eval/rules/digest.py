"""One number for the meaning of a rule: equal meanings hash alike, however they are written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

from safestage_eval.signals import SIGNALS

from . import syntax as ast
from .clauses import CLAUSES

_UNORDERED = {"atoms", "alternatives", "limits", "roles", "excluding", "charge"} | {
    kind for kind, clause in CLAUSES.items() if clause.value == "alternatives"
}
"""Fields whose order says nothing."""
_LATER = {"perhaps", "also", "below", "over"} | (CLAUSES.keys() - {"require", "forbid", "reach"})
"""Fields that came into the language later: where they are not used, a digest is what it was."""


def rule_digest(rules: ast.RuleSet, rule: ast.Scoped, params: ast.Params) -> str:
    """SHA-256 (first 16 hex digits) of a rule as it holds under given parameter values.

    In SI to 12 digits, without prose; definitions, parameters and material columns count only if
    the rule reaches them, parameters with the values given here. 8 cm, 80 mm and 0.08 m hash
    alike; so do the entries of a condition in another order.

    Args:
        rules: where the definitions are.
        rule: one of its rules.
        params: name → value, as they hold for the rule and episode.
    """
    return digest_of(rules, rule, params)


def digest_of(rules: ast.RuleSet, node: object, params: ast.Params) -> str:
    """Digest of any part of a rule, or of a goal; as ``rule_digest``."""
    part = _known(rules, node)
    values = tuple(params[name] for name in part.reads)
    digest = part.digests.get(values)
    if digest is None:
        digest = part.digests[values] = _digest(rules, part, params)
    return digest


def reached(rules: ast.RuleSet, node: Any, params: ast.Params) -> dict[str, ast.Setting | Any]:
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
    """A part of a rule, with all that hangs on it alone.

    Attributes:
        node: the part; kept, so that no other comes to have its identity.
        uses: as ``reached``, with the name of a parameter in place of its value.
        reads: names of the parameters among them.
        digests: the values of these → digest.
    """

    node: object
    uses: dict[str, Any]
    reads: frozenset[str]
    digests: dict[tuple[Any, ...], str]

    @cached_property
    def text(self) -> str:
        """The part as JSON."""
        return _json(self.node)


_MANY = 4096
"""Parts of rules that are remembered at once; goals in headers are new with every episode."""


def _known(rules: ast.RuleSet, node: object) -> _Known:
    """By identity: equal parts are hashed as often as they are asked about, and that takes long."""
    key = tuple(map(id, node)) if isinstance(node, tuple) else id(node)
    part: _Known | None = rules.known.get(("known", key))
    if part is not None:
        return part
    if len(rules.known) > _MANY:
        rules.known.clear()
    uses: dict[str, Any] = {}
    todo = [list(_named(node, rules))]
    while todo:
        for name, value in todo.pop():
            if name not in uses:
                uses[name] = value
                if not isinstance(value, ast.Parameter):
                    todo.append(_definition(rules, name, value).names)
    reads = frozenset([v.name for v in uses.values() if isinstance(v, ast.Parameter)])
    part = rules.known["known", key] = _Known(node, uses, reads, {})
    return part


class _Definition(NamedTuple):
    """The names that a definition uses directly, and its JSON."""

    names: list[tuple[str, Any]]
    text: str


def _definition(rules: ast.RuleSet, name: str, value: Any) -> _Definition:
    """The definition called ``state.moved``, say; a rule set has one of each name."""
    definition: _Definition | None = rules.known.get(("definition", name))
    if definition is None:
        definition = _Definition(list(_named(value, rules)), _json(value))
        rules.known["definition", name] = definition
    return definition


def _digest(rules: ast.RuleSet, part: _Known, params: ast.Params) -> str:
    """Hash ``[part, [[name, definition or value], …], baseline, "gjk"]`` as JSON: the engine of clearances, once a choice."""
    uses = [
        f"[{json.dumps(name)},{_value_json(params[value.name])}]"
        if isinstance(value, ast.Parameter)
        else f"[{json.dumps(name)},{_definition(rules, name, value).text}]"
        for name, value in sorted(part.uses.items())
    ]
    baseline = rules.known.get("baseline")
    if baseline is None:
        baseline = rules.known["baseline"] = _json(rules.baseline)
    text = f'[{part.text},[{",".join(uses)}],{baseline},"gjk"]'
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
            ("signal", rules.derived),
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
    if isinstance(node, tuple):
        for value in node:
            yield from _named(value, rules)
        return
    for field in _compared(type(node)) or ():
        value = getattr(node, field)
        if value is not None and not isinstance(value, _LEAVES):
            yield from _named(value, rules)


_LEAVES = (str, int, float)


_COMPARED: dict[type, tuple[str, ...] | None] = {}


def _compared(kind: type) -> tuple[str, ...] | None:
    """The fields of a part of the syntax that tell it from others, without prose; else None."""
    if kind not in _COMPARED:
        named = [f.name for f in fields(kind) if f.compare] if is_dataclass(kind) else None
        _COMPARED[kind] = None if named is None else tuple(named)
    return _COMPARED[kind]


def _json(node: Any) -> str:
    return json.dumps(_plain(node), sort_keys=True, separators=(",", ":"))


@lru_cache(maxsize=1024)
def _value_json(value: ast.Setting) -> str:
    return _json(value)


def _plain(node: Any) -> Any:
    if isinstance(node, float):
        return float(f"{node:.12g}")
    if node is None or isinstance(node, _LEAVES):
        return node
    if isinstance(node, tuple):
        return [_plain(value) for value in node]
    names = _compared(type(node))
    if names is None:
        return node
    plain: dict[str, Any] = {"": type(node).__name__}
    for name in names:
        # what a rule sets is in the parameter values already
        if name in ("title", "set"):
            continue
        value = _plain(getattr(node, name))
        if value is None and name in _LATER:
            continue
        plain[name] = sorted(value, key=json.dumps) if name in _UNORDERED else value
    return plain
