"""Signals and states that are the same with their two arguments exchanged."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from safestage_eval.rules import RuleSet
from safestage_eval.rules import syntax as ast
from safestage_eval.signals import SIGNALS


def symmetric(rules: RuleSet, name: str) -> bool:
    """A signal, variant or state that does not ask which of its two arguments comes first."""
    if name in rules.signals:
        name = rules.signals[name].base
    state = rules.states.get(name)
    if state is None:
        return name in SIGNALS and SIGNALS[name].symmetric
    turned = {state.of[0]: state.of[1], state.of[1]: state.of[0]} if len(state.of) == 2 else {}
    return bool(turned) and _ordered(rules, state, {}) == _ordered(rules, state, turned)


def _ordered(rules: RuleSet, node: Any, names: dict[str, str]) -> Any:
    """A part of the tree with names exchanged, and the arguments of symmetric calls sorted."""
    if isinstance(node, ast.Call):
        args = [names.get(arg, arg) for arg in node.args]
        if len(args) == 2 and symmetric(rules, node.name):
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
