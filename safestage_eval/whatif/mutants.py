"""Rules broken on purpose: which of the mistakes do the examples notice?

Mutation testing after DeMillo, Lipton and Sayward, "Hints on Test Data Selection" (Computer 11(4),
1978): a set of examples is worth as much as the mistakes that it tells from the rule as meant.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Literal

from safestage_eval.errors import InputError
from safestage_eval.rules import RuleSet, rule_digest, words
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.uses import own_params, uses_of

from .examples import Library, examples_of

Kind = Literal["operator", "unit", "role", "obligation", "truth"]

KINDS: tuple[Kind, ...] = ("operator", "unit", "role", "obligation", "truth")

FACTOR = 10.0
"""A unit mistaken: mm for cm."""

_FLIPPED: dict[str, Literal[">=", "<=", ">", "<"]] = {">=": "<=", "<=": ">=", ">": "<", "<": ">"}

SYMMETRIC = {
    "clearance", "clearance_xy", "contact_force", "peak_force", "relative_speed", "impulse",
}  # fmt: skip
"""Signals that are the same with their arguments exchanged."""


@dataclass(frozen=True)
class Mutant:
    """A rule with one mistake.

    Attributes:
        rule: code.
        kind: of mistake.
        what: the mistake, in words.
        rules: the rule set with it.
    """

    rule: str
    kind: Kind
    what: str
    rules: RuleSet


@dataclass(frozen=True)
class Hunted:
    """A mistake, and what became of it.

    Attributes:
        rule, kind, what: as of the mutant.
        killer: the example that tells it from the rule as meant; None if none does.
    """

    rule: str
    kind: Kind
    what: str
    killer: str | None


def mutants(rules: RuleSet, rule: ast.Rule, *, deep: bool = False) -> Iterator[Mutant]:
    """Every rule that differs by one mistake and means something else.

    Args:
        rules: the set that the rule belongs to.
        rule: as meant.
        deep: also mistakes in the states and phases that it rests on.
    """
    params = own_params(rules, rule)
    seen = {rule_digest(rules, rule, params)}
    for kind, what, changed in _changes(rules, rule, deep=deep):
        mutated = changed.rules[rule.code]
        digest = rule_digest(changed, mutated, own_params(changed, mutated))
        if digest not in seen:
            seen.add(digest)
            yield Mutant(rule.code, kind, what, changed)


def hunt(
    rules: RuleSet,
    rule: ast.Rule,
    library: Library,
    *,
    kinds: Collection[str] = KINDS,
    deep: bool = False,
) -> list[Hunted]:
    """All mutants of a rule, each with the example that kills it.

    An example kills a mutant if it no longer gets the verdict that it should. Examples that are
    missing or wrong to begin with kill nothing.

    Args:
        rules: the set that the rule belongs to.
        rule: as meant.
        library: where the examples are.
        kinds: of mistakes.
        deep: as for ``mutants``.
    """
    sound = _sound(rules, rule, library)
    found = []
    for mutant in mutants(rules, rule, deep=deep):
        if mutant.kind not in kinds:
            continue
        killer = next(
            (
                name
                for name, verdict in sound
                if _verdict(mutant.rules, mutant.rules.rules[rule.code], name, library) != verdict
            ),
            None,
        )
        found.append(Hunted(mutant.rule, mutant.kind, mutant.what, killer))
    return found


def _sound(rules: RuleSet, rule: ast.Rule, library: Library) -> list[tuple[str, str]]:
    return [
        (name, expected)
        for name, expected in examples_of(rule)
        if _verdict(rules, rule, name, library) == expected
    ]


def _verdict(rules: RuleSet, rule: ast.Rule, name: str, library: Library) -> str:
    try:
        return library.judge(name, rules, rule).verdict
    except InputError:
        return "error"


def _changes(rules: RuleSet, rule: ast.Rule, *, deep: bool) -> Iterator[tuple[Kind, str, RuleSet]]:
    params = own_params(rules, rule)
    for kind, what, changed in _of_rule(rules, rule, params):
        yield kind, what, replace(rules, rules={**rules.rules, rule.code: changed})
    columns = uses_of(rules, rule, params).columns
    for column in columns:
        for factor in (FACTOR, 1 / FACTOR):
            rows = {
                material: {
                    name: _scaled(value, factor) if name == column else value
                    for name, value in row.items()
                }
                for material, row in rules.materials.items()
            }
            yield "unit", f"the {column} of materials × {factor:g}", replace(rules, materials=rows)
    if not deep:
        return
    uses = uses_of(rules, rule, params)
    for name in uses.states:
        state = rules.states[name]
        for kind, what, changed in _of_tree(rules, state, params, state.of):
            yield kind, f"in {name}: {what}", replace(rules, states={**rules.states, name: changed})


def _of_rule(
    rules: RuleSet, rule: ast.Rule, params: words.Values
) -> Iterator[tuple[Kind, str, ast.Rule]]:
    yield from _of_tree(rules, rule, params, tuple(name for name, _ in rule.roles))
    for i, item in enumerate(rule.forbid):
        if isinstance(item, ast.Event) and item.call is not None and item.edge is None:
            turned = ast.Condition((ast.StateAtom(item.call, want=False),))
            forbid = (*rule.forbid[:i], turned, *rule.forbid[i + 1 :])
            yield (
                "truth",
                f"never {item.call} → never not {item.call}",
                replace(rule, forbid=forbid),
            )
    asked = len(rule.require.atoms) if rule.require is not None else 0
    if asked + len(rule.forbid) + (rule.reach is not None) < 2:
        return  # a rule that asks for nothing is no rule
    if rule.require is not None:
        for i, atom in enumerate(rule.require.atoms):
            rest = rule.require.atoms[:i] + rule.require.atoms[i + 1 :]
            left = ast.Condition(rest) if rest else None
            yield (
                "obligation",
                f"without: always {words.atom(atom, params)}",
                replace(rule, require=left),
            )
    for i, item in enumerate(rule.forbid):
        rest_of = rule.forbid[:i] + rule.forbid[i + 1 :]
        said = words.alternative(item, params)
        yield "obligation", f"without: never {said}", replace(rule, forbid=rest_of)
    if rule.reach is not None:
        said = words.alternative(rule.reach, params)
        yield "obligation", f"without: at some time {said}", replace(rule, reach=None)


def _of_tree(
    rules: RuleSet, node: Any, params: words.Values, roles: tuple[str, ...]
) -> Iterator[tuple[Kind, str, Any]]:
    """One mistake anywhere in a rule or state: each leaf that can be mistaken, in turn."""
    for kind, what, changed in _mistakes(rules, node, params, roles):
        yield kind, what, changed
    if is_dataclass(node) and not isinstance(node, type):
        for item in fields(node):
            if not item.compare or item.name in ("roles", "severity", "set"):
                continue
            value = getattr(node, item.name)
            for kind, what, changed in _of_tree(rules, value, params, roles):
                yield kind, what, replace(node, **{item.name: changed})
    elif isinstance(node, tuple):
        for i, value in enumerate(node):
            for kind, what, changed in _of_tree(rules, value, params, roles):
                yield kind, what, (*node[:i], changed, *node[i + 1 :])


def _mistakes(
    rules: RuleSet, node: Any, params: words.Values, roles: tuple[str, ...]
) -> Iterator[tuple[Kind, str, Any]]:
    if isinstance(node, ast.SignalAtom):
        yield from _of_limits(node, params)
    elif isinstance(node, ast.StateAtom):
        said = words.atom(node, params)
        turned = replace(node, want=not node.want)
        yield "truth", f"{said} → {words.atom(turned, params)}", turned
    elif isinstance(node, ast.CountAtom):
        said = words.atom(node, params)
        bound: Literal["least", "most"] = "most" if node.bound == "least" else "least"
        turned_count = replace(node, bound=bound)
        yield "operator", f"{said} → {words.atom(turned_count, params)}", turned_count
        more = replace(node, count=node.count + 1)
        yield "unit", f"{said} → {words.atom(more, params)}", more
    elif isinstance(node, ast.Call):
        yield from _of_call(rules, node, roles)


def _of_limits(atom: ast.SignalAtom, params: words.Values) -> Iterator[tuple[Kind, str, Any]]:
    for i, limit in enumerate(atom.limits):
        changes: list[tuple[Kind, ast.Limit]] = [
            ("operator", replace(limit, op=_FLIPPED[limit.op], text=""))
        ]
        number = limit.value
        if isinstance(number, ast.Parameter) and isinstance(params[number.name], ast.Quantity):
            value = params[number.name]
            assert isinstance(value, ast.Quantity)
            number = _scaled(value, -1.0 if number.negative else 1.0)
        if isinstance(number, ast.Quantity) and number.value:
            changes += [
                ("unit", replace(limit, value=_scaled(number, factor), text=""))
                for factor in (FACTOR, 1 / FACTOR)
            ]
        for kind, changed in changes:
            said, other = words.limit(limit, params), words.limit(changed, params)
            limits = (*atom.limits[:i], changed, *atom.limits[i + 1 :])
            yield kind, f"{atom.call} {said} → {other}", replace(atom, limits=limits)


def _of_call(
    rules: RuleSet, call: ast.Call, roles: tuple[str, ...]
) -> Iterator[tuple[Kind, str, Any]]:
    """Arguments exchanged, or another role in the place of one."""
    if len(call.args) == 2 and call.args[0] != call.args[1] and not _symmetric(rules, call.name):
        turned = ast.Call(call.name, call.args[::-1])
        yield "role", f"{call} → {turned}", turned
    for i, arg in enumerate(call.args):
        for other in roles:
            if arg in roles and other not in call.args:
                wrong = ast.Call(call.name, (*call.args[:i], other, *call.args[i + 1 :]))
                yield "role", f"{call} → {wrong}", wrong


def _symmetric(rules: RuleSet, name: str) -> bool:
    """The same with its two arguments exchanged."""
    if name in rules.signals:
        name = rules.signals[name].base
    state = rules.states.get(name)
    if state is None:
        return name in SYMMETRIC
    turned = {state.of[0]: state.of[1], state.of[1]: state.of[0]} if len(state.of) == 2 else {}
    return bool(turned) and _ordered(rules, state, {}) == _ordered(rules, state, turned)


def _ordered(rules: RuleSet, node: Any, names: dict[str, str]) -> Any:
    """A part of the tree with names exchanged, and the arguments of symmetric calls sorted."""
    if isinstance(node, ast.Call):
        args = [names.get(arg, arg) for arg in node.args]
        if len(args) == 2 and _symmetric(rules, node.name):
            args.sort()
        return ast.Call(node.name, tuple(args))
    if is_dataclass(node) and not isinstance(node, type):
        return tuple(
            _ordered(rules, getattr(node, item.name), names)
            for item in fields(node)
            if item.compare and item.name != "of"
        )
    if isinstance(node, tuple):
        return tuple(_ordered(rules, item, names) for item in node)
    return node


def _scaled(value: ast.Quantity, factor: float) -> ast.Quantity:
    return ast.Quantity(value.value * factor, value.dimension)
