"""Mistakes in one place of the tree of a rule, state or phase."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, NamedTuple

from safestage_eval.rules import RuleSet, syntax_words
from safestage_eval.rules import syntax as ast
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


class Place(NamedTuple):
    """Where a mistake is made; ``roles`` are the names that may be exchanged there."""

    rules: RuleSet
    params: ast.Params
    roles: tuple[str, ...]


def scalings(value: ast.Value | None, place: Place) -> Iterator[ast.Quantity]:
    """A value ten times as large, and a tenth of it; none of 0, or of a material's value."""
    if isinstance(value, ast.Parameter):
        held, sign = place.params[value.name], -1.0 if value.negative else 1.0
        value = scaled(held, sign) if isinstance(held, ast.Quantity) else None
    if isinstance(value, ast.Quantity) and value.value:
        yield from (scaled(value, factor) for factor in (FACTOR, 1 / FACTOR))


def tree_mistakes(node: Any, place: Place) -> Iterator[Mistake]:
    """One mistake anywhere in a rule, state or phase: each node that can be mistaken, in turn."""
    yield from _of_node(node, place)
    if is_dataclass(node) and not isinstance(node, type):
        for item in fields(node):
            if not item.compare or item.name in _NOT_WALKED:
                continue
            value = getattr(node, item.name)
            for kind, text, changed in tree_mistakes(value, place):
                yield Mistake(kind, text, replace(node, **{item.name: changed}))
            if item.name in ("for_", "gap", "duration", "recent", "far") and value is not None:
                least = item.name not in ("gap", "recent", "far")
                for text, changed in duration_mistakes(value, place, least):
                    said = f"{item.name.rstrip('_')} {text}"
                    yield Mistake("duration", said, replace(node, **{item.name: changed}))
            if isinstance(value, ast.Event):
                yield from _of_event(node, item.name, value)
    elif isinstance(node, tuple):
        for i, value in enumerate(node):
            for kind, text, changed in tree_mistakes(value, place):
                yield Mistake(kind, text, (*node[:i], changed, *node[i + 1 :]))


def _of_node(node: Any, place: Place) -> Iterator[Mistake]:
    match node:
        case ast.SignalAtom():
            yield from _of_limits(node, place)
            if node.since is not None and node.since.kind != "start":  # it begins at the start
                text = f"{node.call} since {syntax_words.event(node.since)} → since the start"
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


def _told(kind: Kind, atom: ast.Atom, other: ast.Atom, place: Place) -> Mistake:
    said = f"{syntax_words.atom(atom, place.params)} → {syntax_words.atom(other, place.params)}"
    return Mistake(kind, said, other)


def _of_limits(atom: ast.SignalAtom, place: Place) -> Iterator[Mistake]:
    params = place.params
    for i, limit in enumerate(atom.limits):
        changes: list[tuple[Kind, ast.Limit]] = [
            ("operator", replace(limit, op=_FLIPPED[limit.op], text=""))
        ]
        changes += [
            ("unit", replace(limit, value=value, text="")) for value in scalings(limit.value, place)
        ]
        for kind, changed in changes:
            said, other = syntax_words.limit(limit, params), syntax_words.limit(changed, params)
            limits = (*atom.limits[:i], changed, *atom.limits[i + 1 :])
            yield Mistake(kind, f"{atom.call} {said} → {other}", replace(atom, limits=limits))


def _of_call(call: ast.Call, place: Place) -> Iterator[Mistake]:
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


def duration_mistakes(
    duration: ast.Duration | ast.Parameter, place: Place, least: int
) -> Iterator[tuple[str, ast.Duration]]:
    """``least``: whole frames that mean something."""
    lasts = place.params[duration.name] if isinstance(duration, ast.Parameter) else duration
    assert isinstance(lasts, ast.Duration)
    said = syntax_words.duration(duration, place.params)
    for factor in LONGER:
        amount = lasts.amount * factor
        if lasts.frames:
            amount = float(max(least, round(amount)))
        if amount == lasts.amount:
            continue  # one frame is the least there is
        changed = ast.Duration(amount, lasts.frames, lasts.least if factor else 1)
        yield f"{said} → {syntax_words.duration(changed, place.params)}", changed


def _of_event(node: Any, field: str, event: ast.Event) -> Iterator[Mistake]:
    """The other end of a state. A bare state has both; it is mistaken for the frame after it."""
    if event.call is None:
        return
    moved = replace(event, edge="start" if event.edge == "end" else "end", text="")
    said = f"{field} {syntax_words.event(event)} → {syntax_words.event(moved)}"
    yield Mistake("scope", said, replace(node, **{field: moved}))


def _of_span(node: ast.Part | ast.Around | ast.While, place: Place) -> Iterator[Mistake]:
    said = syntax_words.span(node, place.params)
    if isinstance(node, ast.Around):
        after: Literal["before", "after"] = "after" if node.which == "before" else "before"
        other: ast.Span = replace(node, which=after)
    elif isinstance(node, ast.Part):
        last: Literal["first", "last"] = "last" if node.which == "first" else "first"
        other = replace(node, which=last)
    else:
        other = node.of
    yield Mistake("scope", f"{said} → {syntax_words.span(other, place.params)}", other)


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


def scaled(value: ast.Quantity, factor: float) -> ast.Quantity:
    """A value ``factor`` times as large."""
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
