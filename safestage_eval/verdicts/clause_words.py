"""Obligations and scopes of a rule in words, with the names of the bodies that were judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from safestage_eval._text.plural import first_few
from safestage_eval.rules import syntax as ast
from safestage_eval.rules import syntax_words
from safestage_eval.units import format_quantity

from .evaluate import Evaluator
from .explain import seconds
from .instance import Instance
from .obligations import OBLIGATIONS
from .players import field_names, mentions
from .values import Env

MOST = 4
"""Bodies of a role that are listed; of more only the number is."""


def kept(evaluator: Evaluator, clause: ast.Clause, instances: Sequence[Instance]) -> str:
    """The sentence of a pass that no single measurement decides: what held, of whom, and when."""
    first = min(i.scope.first for i in instances)
    stop = max(i.scope.stop for i in instances)
    return OBLIGATIONS[clause.kind].kept.format(
        begin=seconds(float(evaluator.episode.t[first])),
        end=seconds(evaluator.clock.end_of(stop)),
        what=condition(evaluator, clause.what, [i.env for i in instances]),
    )


def unmet(evaluator: Evaluator, rule: ast.Rule, clause: ast.Clause, instance: Instance) -> str:
    """The sentence of a violation that no measurement decides: what did not come, and when."""
    what = condition(evaluator, clause.what, [instance.env])
    return f"Never reached in {scope(evaluator, rule, instance.env)}: {what}."


def scope(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> str:
    """When a rule is judged: ``hold``, ``from the start of taken(cup) to success``."""
    if rule.at is not None:
        return syntax_words.event(with_bodies(rule.at, env, evaluator))
    return syntax_words.span(
        with_bodies(rule.during or ast.Whole(), env, evaluator), evaluator.params
    )


def condition(evaluator: Evaluator, what: ast.Alternative, envs: Sequence[Env]) -> str:
    """A condition or event on one or several combinations of bodies."""
    several = len({tuple(env.items()) for env in envs}) > 1
    part = what if several else with_bodies(what, envs[0], evaluator)
    sole = part.atoms[0] if isinstance(part, ast.Condition) and len(part.atoms) == 1 else None
    parts = sole.alternatives if isinstance(sole, ast.AnyOf) else (part,)
    texts = [syntax_words.alternative(one, evaluator.params) for one in parts]
    if len(texts) > 1:
        texts = [f"({text})" if " and " in text else text for text in texts]
    text = " or ".join(texts)
    if not several:
        return text
    bodies = {
        role: dict.fromkeys(env[role] for env in envs) for role in envs[0] if mentions(what, role)
    }
    return f"{text} ({'; '.join(f'{role}: {first_few([*names], MOST)}' for role, names in bodies.items())})"


def with_bodies(node: Any, env: Env, evaluator: Evaluator) -> Any:
    """A part of a rule with names of bodies in place of roles, and values in place of columns."""
    if isinstance(node, tuple):
        return tuple(with_bodies(item, env, evaluator) for item in node)
    if isinstance(node, ast.Call):
        return replace(node, args=tuple(env.get(arg, arg) for arg in node.args))
    if isinstance(node, ast.Column):
        dimension = evaluator.rules.materials["default"][node.name].dimension
        value = evaluator.number(node, env)
        name = f"{node.name} of {env.get(node.role, node.role)}"
        return ast.Quantity(value, dimension, f"{format_quantity(value, dimension)} ({name})")
    names = field_names(type(node))
    if not names:
        return node
    return replace(
        node, **{name: with_bodies(getattr(node, name), env, evaluator) for name in names}
    )
