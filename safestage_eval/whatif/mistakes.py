"""The mistakes that somebody may make in writing a rule: each change of one place in its tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, NamedTuple

from safestage_eval.rules import RuleSet, words
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.rules.operations import OPERATIONS, Operation
from safestage_eval.rules.uses import own_params, uses_of
from safestage_eval.signals import SIGNALS

Kind = Literal["operator", "unit", "duration", "role", "scope", "obligation", "truth"]

KINDS: tuple[Kind, ...] = (
    "operator", "unit", "duration", "role", "scope", "obligation", "truth",
)  # fmt: skip

FACTOR = 10.0
"""A unit mistaken: mm for cm."""

LONGER = (2.0, 0.5, 0.0)
"""A duration mistaken: twice as long, half as long, none at all."""

_FLIPPED: dict[str, Literal[">=", "<=", ">", "<"]] = {">=": "<=", "<=": ">=", ">": "<", "<": ">"}

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


class _Place(NamedTuple):
    """Where a mistake is made; ``roles`` are the names that may be exchanged there."""

    rules: RuleSet
    params: ast.Params
    roles: tuple[str, ...]


def mistakes(rules: RuleSet, rule: ast.Scoped) -> Iterator[Mistake]:
    """Every mistake in a rule or cost; ``changed`` is the whole rule set with it.

    Args:
        rules: the set that it belongs to.
        rule: as meant.
    """
    params = own_params(rules, rule)
    place = _Place(rules, params, tuple(name for name, _ in rule.roles))
    of_kind = _of_rule(rule, place) if isinstance(rule, ast.Rule) else _of_cost(rule, place)
    for kind, text, changed in (*_of_scope(rule, place), *of_kind):
        yield Mistake(kind, text, rules.with_scoped(changed))
    for column in uses_of(rules, rule, params).columns:
        for factor in (FACTOR, 1 / FACTOR):
            rows = {
                material: {
                    name: _scaled(value, factor) if name == column else value
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
        for kind, text, changed in _of_tree(state, _Place(rules, rules.params, state.of)):
            yield Mistake(kind, text, replace(rules, states={**rules.states, name: changed}))
    else:
        phase = rules.phases[name]
        for kind, text, changed in _of_tree(phase, _Place(rules, rules.params, phase.of)):
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
    place, operands = _Place(rules, rules.params, computed.of), computed.operands
    others: list[tuple[Kind, ast.DerivedDef]] = []
    other = _MISTAKEN.get(computed.operation)
    if other is not None and len(operands) <= OPERATIONS[other].most:
        others.append(("operator", replace(computed, operation=other)))
    if computed.over is not None:
        for _, over in _of_duration(computed.over, place, 1):
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
            for kind, text, changed in _of_tree(operand, place):
                if kind == "truth":
                    continue  # whether it holds is the signal's value
                with_it = (*operands[:i], changed, *operands[i + 1 :])
                yield Mistake(kind, text, replace(computed, operands=with_it))
            continue
        for value in _scalings(operand, place):
            with_it = (*operands[:i], value, *operands[i + 1 :])
            others.append(("unit", replace(computed, operands=with_it)))
    said = words.derived(computed, rules.params)
    for kind, changed in others:
        yield Mistake(kind, f"{said} → {words.derived(changed, rules.params)}", changed)


def _of_scope(rule: ast.Scoped, place: _Place) -> Iterator[Mistake]:
    """Mistakes that rules and costs share: in roles, ``given`` and scope."""
    yield from _of_tree(rule, place)
    yield from _of_roles(rule)
    if rule.given is not None:
        yield from _without("scope", "only if", rule, "given", place)
    if rule.at is not None:
        yield Mistake("scope", f"at {words.event(rule.at)} → always", replace(rule, at=None))
    if rule.during is not None:
        text = f"during {words.span(rule.during, place.params)} → always"
        yield Mistake("scope", text, replace(rule, during=None))
    if rule.until is not None:
        text = f"until {words.event(rule.until)} → to the end"
        yield Mistake("scope", text, replace(rule, until=None))


def _of_rule(rule: ast.Rule, place: _Place) -> Iterator[Mistake]:
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
            text = f"without: {clause.heading} {words.alternative(item, place.params)}"
            yield Mistake("obligation", text, replace(rule, **changed))


def _of_cost(cost: ast.Cost, place: _Place) -> Iterator[Mistake]:
    """Mistakes in the charges and the budget of a cost."""
    for i, charge in enumerate(cost.charge):
        said = words.charge(charge, place.params)
        for kind, changed in _of_charge(charge, cost, place):
            text = f"{said} → {words.charge(changed, place.params)}"
            charges = (*cost.charge[:i], changed, *cost.charge[i + 1 :])
            yield Mistake(kind, text, replace(cost, charge=charges))
        if len(cost.charge) > 1:
            rest = cost.charge[:i] + cost.charge[i + 1 :]
            yield Mistake("obligation", f"without: {said}", replace(cost, charge=rest))
    for budget in _scalings(cost.budget, place):
        text = f"budget → at most {budget.value:g}"
        yield Mistake("unit", text, replace(cost, budget=budget))


def _of_charge(
    charge: ast.Charge, cost: ast.Cost, place: _Place
) -> Iterator[tuple[Kind, ast.Charge]]:
    for above in _scalings(charge.above, place):
        yield "unit", replace(charge, above=above)
    for below in _scalings(charge.below, place):
        yield "unit", replace(charge, below=below)
    if charge.below is not None:
        yield "operator", replace(charge, above=charge.below, below=None)
    if not any(_scalings(cost.budget, place)):
        return  # without a budget to exceed, the first charge decides, whatever it comes to
    if charge.whole:
        yield "operator", replace(charge, whole=None)
    for factor in (FACTOR, 1 / FACTOR):
        yield "unit", replace(charge, add=charge.add * factor)
    for per in ("start", "second", "step"):
        if per != charge.per and not (per == "start" and charge.of is not None):
            yield "unit", replace(charge, per=per)


def _scalings(value: ast.Value | None, place: _Place) -> Iterator[ast.Quantity]:
    """A value ten times as large, and a tenth of it; none of 0, or of a material's value."""
    if isinstance(value, ast.Parameter):
        held, sign = place.params[value.name], -1.0 if value.negative else 1.0
        value = _scaled(held, sign) if isinstance(held, ast.Quantity) else None
    if isinstance(value, ast.Quantity) and value.value:
        yield from (_scaled(value, factor) for factor in (FACTOR, 1 / FACTOR))


def _without(
    kind: Kind, link: str, rule: ast.Scoped, field: str, place: _Place
) -> Iterator[Mistake]:
    """Each atom of a condition of the rule left out."""
    condition: ast.Condition = getattr(rule, field)
    for i, atom in enumerate(condition.atoms):
        rest = condition.atoms[:i] + condition.atoms[i + 1 :]
        left = ast.Condition(rest) if rest else None
        text = f"without: {link} {words.atom(atom, place.params)}"
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
            text = f"{name} = {words.role(spec)} → {words.role(other)}"
            yield Mistake("role", text, replace(rule, roles=roles))


def _of_tree(node: Any, place: _Place) -> Iterator[Mistake]:
    """One mistake anywhere in a rule, state or phase: each node that can be mistaken, in turn."""
    yield from _of_node(node, place)
    if is_dataclass(node) and not isinstance(node, type):
        for item in fields(node):
            if not item.compare or item.name in _NOT_WALKED:
                continue
            value = getattr(node, item.name)
            for kind, text, changed in _of_tree(value, place):
                yield Mistake(kind, text, replace(node, **{item.name: changed}))
            if item.name in ("for_", "gap", "duration", "recent", "far") and value is not None:
                least = item.name not in ("gap", "recent", "far")
                for text, changed in _of_duration(value, place, least):
                    said = f"{item.name.rstrip('_')} {text}"
                    yield Mistake("duration", said, replace(node, **{item.name: changed}))
            if isinstance(value, ast.Event):
                yield from _of_event(node, item.name, value)
    elif isinstance(node, tuple):
        for i, value in enumerate(node):
            for kind, text, changed in _of_tree(value, place):
                yield Mistake(kind, text, (*node[:i], changed, *node[i + 1 :]))


def _of_node(node: Any, place: _Place) -> Iterator[Mistake]:
    match node:
        case ast.SignalAtom():
            yield from _of_limits(node, place)
            if node.since is not None and node.since.kind != "start":  # it begins at the start
                text = f"{node.call} since {words.event(node.since)} → since the start"
                yield Mistake("scope", text, replace(node, since=None))
        case ast.StateAtom():
            turned = replace(node, want=not node.want)
            yield _told("truth", node, turned, place)
        case ast.PastAtom():
            yield _told("truth", node, replace(node, want=not node.want), place)
            if node.begun is not None:
                turned_round = replace(node, call=node.begun, begun=node.call)
                yield _told("operator", node, turned_round, place)
            else:
                how: Literal["once", "always"] = "once" if node.how == "always" else "always"
                yield _told("operator", node, replace(node, how=how), place)
        case ast.PairAtom():
            yield _told("operator", node, replace(node, want=not node.want), place)
        case ast.CountAtom():
            bound: Literal["least", "most"] = "most" if node.bound == "least" else "least"
            yield _told("operator", node, replace(node, bound=bound), place)
            yield _told("unit", node, replace(node, count=node.count + 1), place)
        case ast.Call():
            yield from _of_call(node, place)
        case ast.Column():
            for other in place.roles:
                if other != node.role:
                    text = f"{node.name}({node.role}) → {node.name}({other})"
                    yield Mistake("role", text, replace(node, role=other))
        case ast.Part() | ast.Around() | ast.While():
            yield from _of_span(node, place)
        case ast.StateDef() | ast.PhaseDef():
            yield from _of_definition(node)


def _told(kind: Kind, atom: ast.Atom, other: ast.Atom, place: _Place) -> Mistake:
    said = f"{words.atom(atom, place.params)} → {words.atom(other, place.params)}"
    return Mistake(kind, said, other)


def _of_limits(atom: ast.SignalAtom, place: _Place) -> Iterator[Mistake]:
    params = place.params
    for i, limit in enumerate(atom.limits):
        changes: list[tuple[Kind, ast.Limit]] = [
            ("operator", replace(limit, op=_FLIPPED[limit.op], text=""))
        ]
        changes += [
            ("unit", replace(limit, value=value, text=""))
            for value in _scalings(limit.value, place)
        ]
        for kind, changed in changes:
            said, other = words.limit(limit, params), words.limit(changed, params)
            limits = (*atom.limits[:i], changed, *atom.limits[i + 1 :])
            yield Mistake(kind, f"{atom.call} {said} → {other}", replace(atom, limits=limits))


def _of_call(call: ast.Call, place: _Place) -> Iterator[Mistake]:
    """Arguments exchanged, or another role in the place of one."""
    args = call.args
    if len(args) == 2 and args[0] != args[1] and not _symmetric(place.rules, call.name):
        turned = ast.Call(call.name, args[::-1])
        yield Mistake("role", f"{call} → {turned}", turned)
    for i, arg in enumerate(args):
        for other in place.roles:
            if arg in place.roles and other not in args:
                wrong = ast.Call(call.name, (*args[:i], other, *args[i + 1 :]))
                yield Mistake("role", f"{call} → {wrong}", wrong)


def _of_duration(
    duration: ast.Duration | ast.Parameter, place: _Place, least: int
) -> Iterator[tuple[str, ast.Duration]]:
    """``least``: whole frames that mean something."""
    lasts = place.params[duration.name] if isinstance(duration, ast.Parameter) else duration
    assert isinstance(lasts, ast.Duration)
    said = words.duration(duration, place.params)
    for factor in LONGER:
        amount = lasts.amount * factor
        if lasts.frames:
            amount = float(max(least, round(amount)))
        if amount == lasts.amount:
            continue  # one frame is the least there is
        changed = ast.Duration(amount, lasts.frames, lasts.least if factor else 1)
        yield f"{said} → {words.duration(changed, place.params)}", changed


def _of_event(node: Any, field: str, event: ast.Event) -> Iterator[Mistake]:
    """The other end of a state. A bare state has both; it is mistaken for the frame after it."""
    if event.call is None:
        return
    moved = replace(event, edge="start" if event.edge == "end" else "end", text="")
    said = f"{field} {words.event(event)} → {words.event(moved)}"
    yield Mistake("scope", said, replace(node, **{field: moved}))


def _of_span(node: ast.Part | ast.Around | ast.While, place: _Place) -> Iterator[Mistake]:
    said = words.span(node, place.params)
    if isinstance(node, ast.Around):
        after: Literal["before", "after"] = "after" if node.which == "before" else "before"
        other: ast.Span = replace(node, which=after)
    elif isinstance(node, ast.Part):
        last: Literal["first", "last"] = "last" if node.which == "first" else "first"
        other = replace(node, which=last)
    else:
        other = node.of
    yield Mistake("scope", f"{said} → {words.span(other, place.params)}", other)


def _of_definition(node: ast.StateDef | ast.PhaseDef) -> Iterator[Mistake]:
    """Keys of a state or phase besides its condition, left out."""
    if isinstance(node, ast.StateDef):
        if node.until is not None:
            yield Mistake("scope", "not kept", replace(node, until=None))
        if node.perhaps is not None:
            yield Mistake("scope", "no doubt", replace(node, perhaps=None))
        if node.also is not None:
            yield Mistake("scope", "nothing brief", replace(node, also=None))
    if node.fallback is not None:
        lost = {"fallback": None} | ({"perhaps": None} if isinstance(node, ast.StateDef) else {})
        yield Mistake("scope", "no fallback", replace(node, **lost))  # type: ignore[arg-type]


def _scaled(value: ast.Quantity, factor: float) -> ast.Quantity:
    return ast.Quantity(value.value * factor, value.dimension)


def _symmetric(rules: RuleSet, name: str) -> bool:
    """A signal, variant or state that does not ask which of its two arguments comes first."""
    if name in rules.signals:
        name = rules.signals[name].base
    state = rules.states.get(name)
    if state is None:
        return name in SIGNALS and SIGNALS[name].symmetric
    turned = {state.of[0]: state.of[1], state.of[1]: state.of[0]} if len(state.of) == 2 else {}
    return bool(turned) and _with_sorted_calls(rules, state, {}) == _with_sorted_calls(
        rules, state, turned
    )


def _with_sorted_calls(rules: RuleSet, node: Any, names: dict[str, str]) -> Any:
    """A part of the tree with names exchanged, and the arguments of symmetric calls sorted."""
    if isinstance(node, ast.Call):
        args = [names.get(arg, arg) for arg in node.args]
        if len(args) == 2 and _symmetric(rules, node.name):
            args.sort()
        return ast.Call(node.name, tuple(args))
    if is_dataclass(node) and not isinstance(node, type):
        return tuple(
            _with_sorted_calls(rules, getattr(node, item.name), names)
            for item in fields(node)
            if item.compare and item.name != "of"
        )
    if isinstance(node, tuple):
        return tuple(_with_sorted_calls(rules, item, names) for item in node)
    return node
