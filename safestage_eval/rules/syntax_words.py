"""The syntax tree in words, for readers of rules and lists of changes."""

from __future__ import annotations

from typing import Any

from safestage_eval.units import format_quantity

from . import syntax as ast

_OPS = {">=": "at least", "<=": "at most", ">": "more than", "<": "less than"}


def value(setting: ast.Setting) -> str:
    """A quantity or duration as its author wrote it, else in the unit that reports print."""
    if setting.text:
        return setting.text
    if isinstance(setting, ast.Quantity):
        return format_quantity(setting.value, setting.dimension)
    if setting.frames:
        return f"{setting.amount:g} frame{'s' * (setting.amount != 1)}"
    return f"{setting.amount:g} s"


def limit(node: ast.Limit, params: ast.Params) -> str:
    """``at least 8 cm (min_clearance)``."""
    return f"{_OPS[node.op]} {_bound(node.value, params)}"


def duration(setting: ast.Duration | ast.Parameter, params: ast.Params) -> str:
    """``0.5 s (still_for)``."""
    return _named(setting, params) if isinstance(setting, ast.Parameter) else value(setting)


def event(node: ast.Event) -> str:
    """``success``, ``the end of held(cup)``."""
    if node.call is None:
        return node.kind
    return f"the {node.edge} of {node.call}" if node.edge else str(node.call)


def measured(node: ast.SignalAtom) -> str:
    """``displacement(cup) since success``: a signal without its limits."""
    return f"{node.call} since {event(node.since)}" if node.since is not None else str(node.call)


def atom(node: ast.Atom, params: ast.Params) -> str:
    """One entry of a condition."""
    if isinstance(node, ast.SignalAtom):
        limits = " and ".join(limit(item, params) for item in node.limits)
        return f"{measured(node)} {limits}"
    if isinstance(node, ast.StateAtom):
        return str(node.call) if node.want else f"not {node.call}"
    if isinstance(node, ast.CountAtom):
        return f"{node.call} for at {node.bound} {node.count} {node.role}"
    if len(node.alternatives) == 1:
        return alternative(node.alternatives[0], params)
    return "any of: " + "; ".join(alternative(item, params) for item in node.alternatives)


def condition(node: ast.Condition, params: ast.Params) -> str:
    """All entries in one line."""
    return " and ".join(
        f"({atom(item, params)})"
        if isinstance(item, ast.AnyOf) and len(item.alternatives) > 1 and len(node.atoms) > 1
        else atom(item, params)
        for item in node.atoms
    )


def alternative(node: ast.Alternative, params: ast.Params) -> str:
    """An event, or a condition."""
    return event(node) if isinstance(node, ast.Event) else condition(node, params)


def span(node: ast.Span, params: ast.Params) -> str:
    """The frames that a rule judges."""
    match node:
        case ast.Whole():
            return "the whole episode"
        case ast.PhaseSpan(call) | ast.StateSpan(call):
            return str(call) if call.args else call.name
        case ast.Part(which, lasting, of):
            return f"the {which} {duration(lasting, params)} of {span(of, params)}"
        case ast.Around(which, lasting, about):
            return f"{duration(lasting, params)} {which} {event(about)}"
        case ast.FromTo(begin, stop):
            return f"from {event(begin)} to {event(stop)}"
        case ast.While(of, call):
            return f"{span(of, params)} while {call}"


def role(spec: ast.RoleSpec) -> str:
    """``every object tagged fragile except target``."""
    said = f"every {spec.kind}" if spec.every else spec.kind
    said += f" tagged {spec.tag}" if spec.tag else ""
    return said + (f" except {', '.join(spec.excluding)}" if spec.excluding else "")


def state(node: ast.StateDef, params: ast.Params) -> str:
    """A declared state in words, with how long it must last."""
    parts = [condition(node.when, params)]
    if node.gap is not None:
        parts.append(f"gaps up to {duration(node.gap, params)} are closed")
    if node.for_ is not None:
        parts.append(f"for {duration(node.for_, params)} or longer")
    if node.until is not None:
        parts.append("for good" if node.until.kind == "end" else f"then until {event(node.until)}")
    if node.fallback is not None:
        parts.append(f"where that is unknown: {condition(node.fallback, params)}")
    if node.perhaps is not None:
        parts.append(f"and perhaps where {condition(node.perhaps, params)}")
    if node.also is not None:
        parts.append(f"also, however briefly, where {condition(node.also, params)}")
    return "; ".join(parts)


def derived(node: ast.DerivedDef, params: ast.Params) -> str:
    """``difference of displacement(a) and 2 cm``."""
    said = [
        measured(one)
        if isinstance(one, ast.SignalAtom)
        else str(one.call)
        if isinstance(one, ast.StateAtom)
        else _bound(one, params)
        for one in node.operands
    ]
    over = "" if node.over is None else f" within {duration(node.over, params)}"
    return f"{node.operation} of {' and '.join(said)}{over}"


def phase(node: ast.PhaseDef, params: ast.Params) -> str:
    """The frames of a phase, with what stands in for it."""
    said = span(node.span, params)
    if node.fallback is not None:
        said += f"; if there are none: {span(node.fallback, params)}"
    return said


def charge(node: ast.Charge, params: ast.Params) -> str:
    """``1 per second while contact(robot, vase)``; ``2 per start of …``; ``0.1 per step × …``."""
    said = f"{node.add:g} per {node.per}"
    if node.of is not None and node.per == "start":
        said = f"{node.add:g} at the start of what is judged"
    if node.when is not None:
        link = "of" if node.per == "start" else "while"
        return f"{said} {link} {alternative(node.when, params)}"
    above = f" beyond {_bound(node.above, params)}" if node.above is not None else ""
    if node.below is not None:
        return f"{said} for each SI unit that {node.of} falls short of {_bound(node.below, params)}"
    return f"{said} for each SI unit of {node.of}{above}"


def anything(node: Any, params: ast.Params) -> str:
    """Whatever a rule or definition is made of."""
    match node:
        case ast.Quantity() | ast.Duration():
            return value(node)
        case ast.Parameter():
            return duration(node, params)
        case ast.Condition() | ast.Event():
            return alternative(node, params)
        case ast.SignalAtom() | ast.StateAtom() | ast.CountAtom() | ast.AnyOf():
            return atom(node, params)
        case ast.StateDef():
            return state(node, params)
        case ast.PhaseDef():
            return phase(node, params)
        case ast.DerivedDef():
            return derived(node, params)
        case ast.SignalDef():
            return node.base
        case ast.Cost():
            return "; ".join(charge(one, params) for one in node.charge)
        case ast.Rule():
            return "a rule"
        case tuple():  # roles
            return "; ".join(f"{name}: {role(spec)}" for name, spec in node)
    return span(node, params)


def _bound(bound: ast.Value, params: ast.Params) -> str:
    if isinstance(bound, ast.Quantity):
        return value(bound)
    if isinstance(bound, ast.Parameter):
        return _named(bound, params)
    return f"{'minus ' * bound.negative}the {bound.name} of {bound.role}"


def _named(parameter: ast.Parameter, params: ast.Params) -> str:
    sign = "−" * parameter.negative
    if parameter.name not in params:
        return f"{sign}{parameter.name}"
    return f"{sign}{value(params[parameter.name])} ({parameter.name})"
