"""Mistakes that an author of a rule may make: each changes one place in its tree.

What a node may be mistaken for is told in ``_mistaken``, kind by kind; ``_anywhere`` makes one such
change in a whole rule, state or phase, and says it in words.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, NamedTuple

from safestage_eval.rules import RuleSet, syntax_words
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.rules.operations import OPERATIONS
from safestage_eval.rules.uses import own_params, uses_of
from safestage_eval.signals import SIGNALS

Kind = Literal["operator", "unit", "duration", "role", "scope", "obligation", "truth"]

KINDS: tuple[Kind, ...] = (
    "operator", "unit", "duration", "role", "scope", "obligation", "truth",
)  # fmt: skip

FACTORS = (10.0, 0.1)
"""A unit mistaken: mm for cm."""

LONGER = (2.0, 0.5, 0.0)
"""A duration mistaken: twice as long, half as long, none at all."""

_OTHER: dict[str | None, Any] = {
    ">=": "<=", "<=": ">=", ">": "<", "<": ">",
    "least": "most", "most": "least", "before": "after", "after": "before", "first": "last",
    "last": "first", "start": "end", "end": "start", None: "end",
}  # fmt: skip
"""A word → the one that it is mistaken for."""

_LEAST = {"for_": 1, "duration": 1, "gap": 0}
"""Fields that are durations → whole frames that mean something."""

_LEFT_OUT = {
    "until": "not kept",
    "perhaps": "no doubt",
    "also": "nothing brief",
    "fallback": "no fallback",
}
"""Keys of a state or phase besides its condition → what it is without them."""

_NOT_WALKED = ("roles", "severity", "set")


class Mistake(NamedTuple):
    """A part of a rule, changed in one place.

    Attributes:
        kind: of mistake.
        what: in words.
        changed: the part with it.
    """

    kind: Kind
    what: str
    changed: Any


class Place(NamedTuple):
    """Where a mistake is made; ``roles`` are the names that may be exchanged there."""

    rules: RuleSet
    params: ast.Params
    roles: tuple[str, ...]


def mistakes(rules: RuleSet, name: str) -> Iterator[Mistake]:
    """Every mistake in a rule, cost or definition; ``changed`` is the whole rule set with it.

    Args:
        rules: the set that it belongs to.
        name: code, or name of a state, a phase, a variant of a signal or one that is computed.
    """
    if name not in rules.scoped:
        table, part = definition(rules, name)
        for kind, text, changed in _anywhere(
            part, Place(rules, rules.params, getattr(part, "of", ()))
        ):
            with_it: dict[str, Any] = {table: {**getattr(rules, table), name: changed}}
            yield Mistake(kind, text, replace(rules, **with_it))
        return
    rule = rules.scoped[name]
    params = own_params(rules, rule)
    place = Place(rules, params, tuple(name for name, _ in rule.roles))
    own = _of_rule(rule, place) if isinstance(rule, ast.Rule) else _of_cost(rule, place)
    for kind, text, changed in (*_anywhere(rule, place), *_of_scope(rule, place), *own):
        yield Mistake(kind, text, rules.with_scoped(changed))
    for column in uses_of(rules, rule, params).columns:
        for factor in FACTORS:
            rows = {
                material: {n: _scaled(v, factor) if n == column else v for n, v in row.items()}
                for material, row in rules.materials.items()
            }
            text = f"the {column} of materials × {factor:g}"
            yield Mistake("unit", text, replace(rules, materials=rows))


def definition(rules: RuleSet, name: str) -> tuple[str, Any]:
    """The table of a rule set that declares a name, and what it declares there."""
    table = next(t for t in ("states", "phases", "signals", "derived") if name in getattr(rules, t))
    return table, getattr(rules, table)[name]


def _anywhere(node: Any, place: Place) -> Iterator[Mistake]:
    """One mistake anywhere in a part of the rules: each node that can be mistaken, in turn."""
    yield from _mistaken(node, place)
    if isinstance(node, tuple):
        for i, value in enumerate(node):
            for kind, text, changed in _anywhere(value, place):
                yield Mistake(kind, text, (*node[:i], changed, *node[i + 1 :]))
    if not is_dataclass(node) or isinstance(node, type):
        return
    for item in fields(node):
        name, value = item.name, getattr(node, item.name)
        if not item.compare or name in _NOT_WALKED or value is None:
            continue
        inner = [*_anywhere(value, place)]
        if isinstance(node, ast.DerivedDef):  # whether a state holds is the signal's value
            inner = [one for one in inner if one.kind != "truth"]
        if name in _LEAST:
            said = f"{name.rstrip('_')} {syntax_words.duration(value, place.params)}"
            inner += [
                Mistake("duration", f"{said} → {syntax_words.duration(other, place.params)}", other)
                for other in _durations(value, place, _LEAST[name])
            ]
        if isinstance(value, ast.Event) and value.call is not None:
            # the other end of a state; a bare state has both, and is mistaken for the frame after it
            other = replace(value, edge=_OTHER[value.edge], text="")
            said = f"{name} {syntax_words.event(value)} → {syntax_words.event(other)}"
            inner.append(Mistake("scope", said, other))
        for kind, text, changed in inner:
            yield Mistake(kind, text, replace(node, **{name: changed}))


def _mistaken(node: Any, place: Place) -> Iterator[Mistake]:
    """What one node may be mistaken for, but for what is in its parts."""
    match node:
        case ast.SignalAtom():
            yield from _of_limits(node, place)
            if node.since is not None and node.since.kind != "start":  # it begins at the start
                text = f"{node.call} since {syntax_words.event(node.since)} → since the start"
                yield Mistake("scope", text, replace(node, since=None))
        case ast.StateAtom():
            yield from _atoms(node, place, ("truth", {"want": not node.want}))
        case ast.CountAtom():
            other, more = {"bound": _OTHER[node.bound]}, {"count": node.count + 1}
            yield from _atoms(node, place, ("operator", other), ("unit", more))
        case ast.Call():
            yield from _of_call(node, place)
        case ast.Column():
            for other_role in place.roles:
                if other_role != node.role:
                    text = f"{node.name}({node.role}) → {node.name}({other_role})"
                    yield Mistake("role", text, replace(node, role=other_role))
        case ast.Part() | ast.Around() | ast.While():
            span = (
                node.of if isinstance(node, ast.While) else replace(node, which=_OTHER[node.which])
            )
            said = [syntax_words.span(one, place.params) for one in (node, span)]
            yield Mistake("scope", " → ".join(said), span)
        case ast.StateDef() | ast.PhaseDef():
            for name, text in _LEFT_OUT.items():
                if getattr(node, name, None) is not None:
                    lost = {name: None}
                    if name == "fallback" and isinstance(node, ast.StateDef):
                        lost["perhaps"] = None
                    yield Mistake("scope", text, replace(node, **lost))  # type: ignore[arg-type]
        case ast.SignalDef():
            yield from _of_variant(node)
        case ast.DerivedDef():
            before = syntax_words.derived(node, place.params)
            for kind, computed in _of_computed(node, place):
                text = f"{before} → {syntax_words.derived(computed, place.params)}"
                yield Mistake(kind, text, computed)


def _atoms(node: Any, place: Place, *changes: tuple[Kind, dict[str, Any]]) -> Iterator[Mistake]:
    """An atom with some of its fields changed."""
    for kind, change in changes:
        other = replace(node, **change)
        said = [syntax_words.atom(one, place.params) for one in (node, other)]
        yield Mistake(kind, " → ".join(said), other)


def _of_limits(atom: ast.SignalAtom, place: Place) -> Iterator[Mistake]:
    """The comparison turned round, the limit ten times as large or small."""
    for i, limit in enumerate(atom.limits):
        changes: list[tuple[Kind, dict[str, Any]]] = [("operator", {"op": _OTHER[limit.op]})]
        changes += [("unit", {"value": value}) for value in _scalings(limit.value, place)]
        for kind, change in changes:
            changed = replace(limit, text="", **change)
            said = [syntax_words.limit(one, place.params) for one in (limit, changed)]
            limits = (*atom.limits[:i], changed, *atom.limits[i + 1 :])
            yield Mistake(kind, f"{atom.call} {' → '.join(said)}", replace(atom, limits=limits))


def _of_call(call: ast.Call, place: Place) -> Iterator[Mistake]:
    """Arguments exchanged, or another role in the place of one."""
    args, others = call.args, list[tuple[str, ...]]()
    if len(args) == 2 and args[0] != args[1] and not _symmetric(place.rules, call.name):
        others.append(args[::-1])
    others += [
        (*args[:i], other, *args[i + 1 :])
        for i, arg in enumerate(args)
        for other in place.roles
        if arg in place.roles and other not in args
    ]
    for wrong in others:
        yield Mistake("role", f"{call} → {ast.Call(call.name, wrong)}", ast.Call(call.name, wrong))


def _of_variant(variant: ast.SignalDef) -> Iterator[Mistake]:
    """A time or box ten times as large, or a tenth of it; another way to measure a distance."""
    declared = {option.name: option for option in SIGNALS[variant.base].options}
    for i, (option, value) in enumerate(variant.options):
        others: dict[str, float | str | tuple[float, ...]] = {}
        if declared[option].kind == "choice":
            others = {other: other for other in declared[option].choices if other != value}
        elif not isinstance(value, str | ast.Parameter):
            for factor in FACTORS:
                size = [x * factor for x in (value if isinstance(value, tuple) else (value,))]
                others[f"× {factor:g}"] = tuple(size) if isinstance(value, tuple) else size[0]
        for said, other in others.items():
            options = (*variant.options[:i], (option, other), *variant.options[i + 1 :])
            yield Mistake("unit", f"{option} → {said}", replace(variant, options=options))


def _of_computed(computed: ast.DerivedDef, place: Place) -> Iterator[tuple[Kind, ast.DerivedDef]]:
    """Operands exchanged or left out, a constant ten times as large."""
    operands = computed.operands
    if computed.over is not None:
        for over in _durations(computed.over, place, 1):
            if over.amount:
                yield "duration", replace(computed, over=over)
    if computed.operation == "difference":
        yield "operator", replace(computed, operands=operands[::-1])
    for i, operand in enumerate(operands):
        rest = operands[:i] + operands[i + 1 :]
        signals = [one for one in rest if isinstance(one, ast.SignalAtom)]
        if len(rest) >= OPERATIONS[computed.operation].least and signals:
            yield "obligation", replace(computed, operands=rest)
        if not isinstance(operand, ast.SignalAtom | ast.StateAtom):
            for value in _scalings(operand, place):
                yield "unit", replace(computed, operands=(*operands[:i], value, *operands[i + 1 :]))


def _of_scope(rule: ast.Scoped, place: Place) -> Iterator[Mistake]:
    """Mistakes that rules and costs share: in roles, ``given`` and scope."""
    for i, (name, spec) in enumerate(rule.roles):
        wider = [{"tag": None}] * bool(spec.tag)
        kept = [tuple(one for one in spec.excluding if one != out) for out in spec.excluding]
        for change in (*wider, *({"excluding": some} for some in kept)):
            other = replace(spec, text="", **change)  # type: ignore[arg-type]
            roles = (*rule.roles[:i], (name, other), *rule.roles[i + 1 :])
            text = f"{name} = {syntax_words.role(spec)} → {syntax_words.role(other)}"
            yield Mistake("role", text, replace(rule, roles=roles))
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


def _of_cost(cost: ast.Cost, place: Place) -> Iterator[Mistake]:
    """Mistakes in the charges and the budget of a cost."""
    for i, charge in enumerate(cost.charge):
        said, rest = syntax_words.charge(charge, place.params), cost.charge[i + 1 :]
        for kind, changed in _of_charge(charge, cost, place):
            text = f"{said} → {syntax_words.charge(changed, place.params)}"
            yield Mistake(kind, text, replace(cost, charge=(*cost.charge[:i], changed, *rest)))
        if len(cost.charge) > 1:
            fewer = replace(cost, charge=cost.charge[:i] + rest)
            yield Mistake("obligation", f"without: {said}", fewer)
    for budget in _scalings(cost.budget, place):
        text = f"budget → at most {budget.value:g}"
        yield Mistake("unit", text, replace(cost, budget=budget))


def _of_charge(
    charge: ast.Charge, cost: ast.Cost, place: Place
) -> Iterator[tuple[Kind, ast.Charge]]:
    for above in _scalings(charge.above, place):
        yield "unit", replace(charge, above=above)
    for below in _scalings(charge.below, place):
        yield "unit", replace(charge, below=below)
    if charge.below is not None:
        yield "operator", replace(charge, above=charge.below, below=None)
    if not any(_scalings(cost.budget, place)):
        return  # without a budget to exceed, the first charge decides, whatever it comes to
    for factor in FACTORS:
        yield "unit", replace(charge, add=charge.add * factor)
    for per in ("start", "second", "step"):
        if per != charge.per and not (per == "start" and charge.of is not None):
            yield "unit", replace(charge, per=per)


def _durations(
    duration: ast.Duration | ast.Parameter, place: Place, least: int
) -> Iterator[ast.Duration]:
    """A duration twice as long, half as long, and none; ``least``: frames that mean something."""
    lasts = place.params[duration.name] if isinstance(duration, ast.Parameter) else duration
    assert isinstance(lasts, ast.Duration)
    for factor in LONGER:
        amount = lasts.amount * factor
        if lasts.frames:
            amount = float(max(least, round(amount)))
        if amount != lasts.amount:  # one frame is the least there is
            yield ast.Duration(amount, lasts.frames, lasts.least if factor else 1)


def _scalings(value: Any, place: Place) -> Iterator[ast.Quantity]:
    """A value ten times as large, and a tenth of it; none of 0, or of a material's value."""
    if isinstance(value, ast.Parameter):
        held, sign = place.params[value.name], -1.0 if value.negative else 1.0
        value = _scaled(held, sign) if isinstance(held, ast.Quantity) else None
    if isinstance(value, ast.Quantity) and value.value:
        yield from (_scaled(value, factor) for factor in FACTORS)


def _scaled(value: ast.Quantity, factor: float) -> ast.Quantity:
    return ast.Quantity(value.value * factor, value.dimension)


def _symmetric(rules: RuleSet, name: str) -> bool:
    """A signal, variant or state that does not ask which of its two arguments comes first."""
    if name in rules.signals:
        name = rules.signals[name].base
    state = rules.states.get(name)
    if state is None:
        return name in SIGNALS and SIGNALS[name].symmetric
    if len(state.of) != 2:
        return False
    turned = dict(zip(state.of, state.of[::-1], strict=True))
    return bool(_sorted(rules, state, {}) == _sorted(rules, state, turned))


def _sorted(rules: RuleSet, node: Any, names: dict[str, str]) -> Any:
    """A part of the tree with names exchanged, and the arguments of symmetric calls sorted."""
    if isinstance(node, ast.Call):
        args = [names.get(arg, arg) for arg in node.args]
        alike = len(args) == 2 and _symmetric(rules, node.name)
        return ast.Call(node.name, tuple(sorted(args) if alike else args))
    if is_dataclass(node) and not isinstance(node, type):
        own = [f.name for f in fields(node) if f.compare and f.name != "of"]
        return tuple(_sorted(rules, getattr(node, name), names) for name in own)
    if isinstance(node, tuple):
        return tuple(_sorted(rules, item, names) for item in node)
    return node
