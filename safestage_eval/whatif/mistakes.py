"""Mistakes that an author of a rule may make: each changes one place in its tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from safestage_eval.rules import RuleSet, syntax_words
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.rules.operations import OPERATIONS, Operation
from safestage_eval.rules.uses import own_params, uses_of
from safestage_eval.signals import SIGNALS

from .tree_mistakes import (
    FACTOR,
    Kind,
    Mistake,
    Place,
    duration_mistakes,
    scaled,
    scalings,
    tree_mistakes,
)  # fmt: skip


def mistakes(rules: RuleSet, rule: ast.Scoped) -> Iterator[Mistake]:
    """Every mistake in a rule or cost; ``changed`` is the whole rule set with it.

    Args:
        rules: the set that it belongs to.
        rule: as meant.
    """
    params = own_params(rules, rule)
    place = Place(rules, params, tuple(name for name, _ in rule.roles))
    of_kind = _of_rule(rule, place) if isinstance(rule, ast.Rule) else _of_cost(rule, place)
    for kind, text, changed in (*_of_scope(rule, place), *of_kind):
        yield Mistake(kind, text, rules.with_scoped(changed))
    for column in uses_of(rules, rule, params).columns:
        for factor in (FACTOR, 1 / FACTOR):
            rows = {
                material: {
                    name: scaled(value, factor) if name == column else value
                    for name, value in row.items()
                }
                for material, row in rules.materials.items()
            }
            text = f"the {column} of materials × {factor:g}"
            yield Mistake("unit", text, replace(rules, materials=rows))


def mistakes_in(rules: RuleSet, name: str) -> Iterator[Mistake]:
    """Every mistake in a definition; ``changed`` is the whole rule set with it.

    Args:
        rules: the set that declares it.
        name: of a state, a phase, a variant of a signal or one that is computed.
    """
    if name in rules.signals:
        for kind, text, variant in _of_variant(rules.signals[name]):
            yield Mistake(kind, text, replace(rules, signals={**rules.signals, name: variant}))
    elif name in rules.derived:
        for kind, text, computed in _of_computed(rules.derived[name], rules):
            yield Mistake(kind, text, replace(rules, derived={**rules.derived, name: computed}))
    elif name in rules.states:
        state = rules.states[name]
        for kind, text, changed in tree_mistakes(state, Place(rules, rules.params, state.of)):
            yield Mistake(kind, text, replace(rules, states={**rules.states, name: changed}))
    else:
        phase = rules.phases[name]
        for kind, text, changed in tree_mistakes(phase, Place(rules, rules.params, phase.of)):
            yield Mistake(kind, text, replace(rules, phases={**rules.phases, name: changed}))


def _of_variant(variant: ast.SignalDef) -> Iterator[Mistake]:
    """A time or box ten times as large, or a tenth of it; another way to measure a distance."""
    declared = {option.name: option for option in SIGNALS[variant.base].options}
    for i, (option, value) in enumerate(variant.options):
        others: dict[str, float | str | tuple[float, ...]] = {}
        if declared[option].kind == "choice":
            others = {other: other for other in declared[option].choices if other != value}
        elif not isinstance(value, str | ast.Parameter):
            for factor in (FACTOR, 1 / FACTOR):
                size = [x * factor for x in (value if isinstance(value, tuple) else (value,))]
                others[f"× {factor:g}"] = tuple(size) if isinstance(value, tuple) else size[0]
        for said, other in others.items():
            options = (*variant.options[:i], (option, other), *variant.options[i + 1 :])
            yield Mistake("unit", f"{option} → {said}", replace(variant, options=options))


_MISTAKEN: dict[Operation, Operation] = {
    "sum": "difference", "difference": "sum", "min": "max", "max": "min",
}  # fmt: skip
"""An operation mistaken for one of the same dimension."""


def _of_computed(computed: ast.DerivedDef, rules: RuleSet) -> Iterator[Mistake]:
    """Another operation, operands exchanged or left out, a constant ten times as large."""
    place, operands = Place(rules, rules.params, computed.of), computed.operands
    others: list[tuple[Kind, ast.DerivedDef]] = []
    other = _MISTAKEN.get(computed.operation)
    if other is not None and len(operands) <= OPERATIONS[other].most:
        others.append(("operator", replace(computed, operation=other)))
    if computed.over is not None:
        for _, over in duration_mistakes(computed.over, place, 1):
            if over.amount:
                others.append(("duration", replace(computed, over=over)))
    if computed.operation == "difference":
        others.append(("operator", replace(computed, operands=operands[::-1])))
    for i, operand in enumerate(operands):
        rest = operands[:i] + operands[i + 1 :]
        signals = [one for one in rest if isinstance(one, ast.SignalAtom)]
        if len(rest) >= OPERATIONS[computed.operation].least and signals:
            others.append(("obligation", replace(computed, operands=rest)))
        if isinstance(operand, ast.SignalAtom | ast.StateAtom):
            for kind, text, changed in tree_mistakes(operand, place):
                if kind == "truth":
                    continue  # whether it holds is the signal's value
                with_it = (*operands[:i], changed, *operands[i + 1 :])
                yield Mistake(kind, text, replace(computed, operands=with_it))
            continue
        for value in scalings(operand, place):
            with_it = (*operands[:i], value, *operands[i + 1 :])
            others.append(("unit", replace(computed, operands=with_it)))
    said = syntax_words.derived(computed, rules.params)
    for kind, changed in others:
        yield Mistake(kind, f"{said} → {syntax_words.derived(changed, rules.params)}", changed)


def _of_scope(rule: ast.Scoped, place: Place) -> Iterator[Mistake]:
    """Mistakes that rules and costs share: in roles, ``given`` and scope."""
    yield from tree_mistakes(rule, place)
    yield from _of_roles(rule)
    if rule.given is not None:
        yield from _without("scope", "only if", rule, "given", place)
    if rule.at is not None:
        yield Mistake("scope", f"at {syntax_words.event(rule.at)} → always", replace(rule, at=None))
    if rule.during is not None:
        text = f"during {syntax_words.span(rule.during, place.params)} → always"
        yield Mistake("scope", text, replace(rule, during=None))
    if rule.until is not None:
        text = f"until {syntax_words.event(rule.until)} → to the end"
        yield Mistake("scope", text, replace(rule, until=None))


def _of_rule(rule: ast.Rule, place: Place) -> Iterator[Mistake]:
    """Mistakes in the obligations of a rule."""
    for i, item in enumerate(rule.forbid):
        if isinstance(item, ast.Event) and item.call is not None and item.edge is None:
            turned = ast.Condition((ast.StateAtom(item.call, want=False),))
            forbid = (*rule.forbid[:i], turned, *rule.forbid[i + 1 :])
            text = f"never {item.call} → never not {item.call}"
            yield Mistake("truth", text, replace(rule, forbid=forbid))
    if sum(len(clause.entries(getattr(rule, kind))) for kind, clause in CLAUSES.items()) < 2:
        return  # a rule that asks for nothing is no rule
    for kind, clause in CLAUSES.items():
        value = getattr(rule, kind)
        if clause.value == "condition":
            if value is not None:
                yield from _without("obligation", clause.heading, rule, kind, place)
            continue
        for i, item in enumerate(clause.entries(value)):
            rest = value[:i] + value[i + 1 :] if isinstance(value, tuple) else None
            changed: dict[str, Any] = {kind: rest}
            text = f"without: {clause.heading} {syntax_words.alternative(item, place.params)}"
            yield Mistake("obligation", text, replace(rule, **changed))


def _of_cost(cost: ast.Cost, place: Place) -> Iterator[Mistake]:
    """Mistakes in the charges and the budget of a cost."""
    for i, charge in enumerate(cost.charge):
        said = syntax_words.charge(charge, place.params)
        for kind, changed in _of_charge(charge, cost, place):
            text = f"{said} → {syntax_words.charge(changed, place.params)}"
            charges = (*cost.charge[:i], changed, *cost.charge[i + 1 :])
            yield Mistake(kind, text, replace(cost, charge=charges))
        if len(cost.charge) > 1:
            rest = cost.charge[:i] + cost.charge[i + 1 :]
            yield Mistake("obligation", f"without: {said}", replace(cost, charge=rest))
    for budget in scalings(cost.budget, place):
        text = f"budget → at most {budget.value:g}"
        yield Mistake("unit", text, replace(cost, budget=budget))


def _of_charge(
    charge: ast.Charge, cost: ast.Cost, place: Place
) -> Iterator[tuple[Kind, ast.Charge]]:
    for above in scalings(charge.above, place):
        yield "unit", replace(charge, above=above)
    for below in scalings(charge.below, place):
        yield "unit", replace(charge, below=below)
    if charge.below is not None:
        yield "operator", replace(charge, above=charge.below, below=None)
    if not any(scalings(cost.budget, place)):
        return  # without a budget to exceed, the first charge decides, whatever it comes to
    if charge.whole:
        yield "operator", replace(charge, whole=None)
    for factor in (FACTOR, 1 / FACTOR):
        yield "unit", replace(charge, add=charge.add * factor)
    for per in ("start", "second", "step"):
        if per != charge.per and not (per == "start" and charge.of is not None):
            yield "unit", replace(charge, per=per)


def _without(
    kind: Kind, link: str, rule: ast.Scoped, field: str, place: Place
) -> Iterator[Mistake]:
    """Each atom of a condition of the rule left out."""
    condition: ast.Condition = getattr(rule, field)
    for i, atom in enumerate(condition.atoms):
        rest = condition.atoms[:i] + condition.atoms[i + 1 :]
        left = ast.Condition(rest) if rest else None
        text = f"without: {link} {syntax_words.atom(atom, place.params)}"
        yield Mistake(kind, text, replace(rule, **{field: left}))  # type: ignore[arg-type]


def _of_roles(rule: ast.Scoped) -> Iterator[Mistake]:
    """Too many bodies play a role."""
    for i, (name, spec) in enumerate(rule.roles):
        wider = [replace(spec, tag=None, text="")] if spec.tag else []
        wider += [replace(spec, named=None, text="")] if spec.named is not None else []
        wider += [
            replace(spec, excluding=tuple(e for e in spec.excluding if e != out), text="")
            for out in spec.excluding
        ]
        for other in wider:
            roles = (*rule.roles[:i], (name, other), *rule.roles[i + 1 :])
            text = f"{name} = {syntax_words.role(spec)} → {syntax_words.role(other)}"
            yield Mistake("role", text, replace(rule, roles=roles))
