"""The syntax tree back in words, for people who read a rule, and for lists of what changed."""

from __future__ import annotations

from safestage_eval.units import format_quantity

from . import syntax as ast

_OPS = {">=": "at least", "<=": "at most", ">": "more than", "<": "less than"}


def value(found: ast.Setting) -> str:
    """A quantity or duration as its author wrote it, else in the unit that reports print."""
    if found.text:
        return found.text
    if isinstance(found, ast.Quantity):
        return format_quantity(found.value, found.dimension)
    if found.frames:
        return f"{found.amount:g} frame{'s' * (found.amount != 1)}"
    return f"{found.amount:g} s"


def limit(found: ast.Limit, params: ast.Params) -> str:
    """``at least 8 cm (min_clearance)``."""
    return f"{_OPS[found.op]} {_bound(found.value, params)}"


def duration(found: ast.Duration | ast.Parameter, params: ast.Params) -> str:
    """``0.5 s (still_for)``."""
    return _named(found, params) if isinstance(found, ast.Parameter) else value(found)


def event(found: ast.Event) -> str:
    """``success``, ``the end of held(cup)``."""
    if found.call is None:
        return found.kind
    return f"the {found.edge} of {found.call}" if found.edge else str(found.call)


def atom(found: ast.Atom, params: ast.Params) -> str:
    """One entry of a condition."""
    if isinstance(found, ast.SignalAtom):
        since = f" since {event(found.since)}" if found.since is not None else ""
        limits = " and ".join(limit(item, params) for item in found.limits)
        return f"{found.call}{since} {limits}"
    if isinstance(found, ast.StateAtom):
        return str(found.call) if found.want else f"not {found.call}"
    if isinstance(found, ast.PastAtom):
        return _past(found, params)
    if isinstance(found, ast.PairAtom):
        if found.want:
            return f"{found.call} exactly where {found.other}"
        return f"either {found.call} or {found.other}"
    if isinstance(found, ast.CountAtom):
        return f"{found.call} for at {found.bound} {found.count} {found.role}"
    if len(found.alternatives) == 1:
        return alternative(found.alternatives[0], params)
    return "any of: " + "; ".join(alternative(item, params) for item in found.alternatives)


def _past(found: ast.PastAtom, params: ast.Params) -> str:
    """``once from 2 s to 0.5 s ago contact(a, b)``."""
    begin = "the start" if found.far is None else f"{duration(found.far, params)} ago"
    recent = duration(found.recent, params)
    when = f"from {begin} to {'now' if recent == '0 s' else f'{recent} ago'}"
    said = f"{found.how} {when} {found.call}"
    if found.begun is not None:
        said = f"{found.call} ever since {found.begun} {when}"
    return said if found.want else f"not ({said})"


def condition(found: ast.Condition, params: ast.Params) -> str:
    """All entries in one line."""
    return " and ".join(
        f"({atom(item, params)})"
        if isinstance(item, ast.AnyOf) and len(item.alternatives) > 1 and len(found.atoms) > 1
        else atom(item, params)
        for item in found.atoms
    )


def alternative(found: ast.Alternative, params: ast.Params) -> str:
    """An event, or a condition."""
    return event(found) if isinstance(found, ast.Event) else condition(found, params)


def span(found: ast.Span, params: ast.Params) -> str:
    """The frames that a rule judges."""
    match found:
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


def role(found: ast.RoleSpec) -> str:
    """``every object tagged fragile except target``."""
    said = f"every {found.kind}" if found.every else found.kind
    said += {True: " named by the task", False: " not named by the task", None: ""}[found.named]
    said += f" tagged {found.tag}" if found.tag else ""
    return said + (f" except {', '.join(found.excluding)}" if found.excluding else "")


def state(found: ast.StateDef, params: ast.Params) -> str:
    """A declared state in words, with how long it must last."""
    parts = [condition(found.when, params)]
    if found.gap is not None:
        parts.append(f"gaps up to {duration(found.gap, params)} are closed")
    if found.for_ is not None:
        parts.append(f"for {duration(found.for_, params)} or longer")
    if found.until is not None:
        parts.append(
            "for good" if found.until.kind == "end" else f"then until {event(found.until)}"
        )
    if found.fallback is not None:
        parts.append(f"where that is unknown: {condition(found.fallback, params)}")
    if found.perhaps is not None:
        parts.append(f"and perhaps where {condition(found.perhaps, params)}")
    if found.also is not None:
        parts.append(f"also, however briefly, where {condition(found.also, params)}")
    return "; ".join(parts)


def derived(found: ast.DerivedDef, params: ast.Params) -> str:
    """``difference of displacement(a) and 2 cm``."""
    said = [
        f"{one.call}{'' if one.since is None else f' since {event(one.since)}'}"
        if isinstance(one, ast.SignalAtom)
        else str(one.call)
        if isinstance(one, ast.StateAtom)
        else _bound(one, params)
        for one in found.operands
    ]
    over = "" if found.over is None else f" within {duration(found.over, params)}"
    return f"{found.operation} of {' and '.join(said)}{over}"


def phase(found: ast.PhaseDef, params: ast.Params) -> str:
    """The frames of a phase, with what stands in for it."""
    said = span(found.span, params)
    if found.fallback is not None:
        said += f"; if there are none: {span(found.fallback, params)}"
    return said


def charge(found: ast.Charge, params: ast.Params) -> str:
    """``1 per second while contact(robot, vase)``; ``2 per start of …``; ``0.1 per step × …``."""
    said = f"{found.add:g} per {found.per}"
    if found.of is not None and found.per == "start":
        said = f"{found.add:g} at the start of what is judged"
    if found.when is not None:
        link = "of" if found.per == "start" else "while"
        return f"{said} {link} {alternative(found.when, params)}"
    above = f" beyond {_bound(found.above, params)}" if found.above is not None else ""
    if found.below is not None:
        return (
            f"{said} for each SI unit that {found.of} falls short of {_bound(found.below, params)}"
        )
    if found.whole:
        return f"{said} for each SI unit of {found.of}, all of it where it is{above or ' beyond 0'}"
    return f"{said} for each SI unit of {found.of}{above}"


def _bound(found: ast.Value, params: ast.Params) -> str:
    if isinstance(found, ast.Quantity):
        return value(found)
    if isinstance(found, ast.Parameter):
        return _named(found, params)
    return f"{'minus ' * found.negative}the {found.name} of {found.role}"


def _named(found: ast.Parameter, params: ast.Params) -> str:
    sign = "−" * found.negative
    if found.name not in params:
        return f"{sign}{found.name}"
    return f"{sign}{value(params[found.name])} ({found.name})"
