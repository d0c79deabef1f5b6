"""The strings of the rule language: their grammar, which reads them, and the nodes of the syntax tree that they are.

``GRAMMAR`` is what strings are matched with; the schema's patterns and the page of the language are made from it.
Each reader makes a node of the parts that its production matched, and of them those within. Each node that names
something knows at which character of its string it does. Nothing is ever evaluated.
"""

from __future__ import annotations

import re
from functools import cache, lru_cache
from typing import Any, Literal, cast

from safestage_eval.errors import shortened
from safestage_eval.units import DIMENSIONS, FINITE, LONGEST, UNIT_DIMENSION, finite, in_si

from . import syntax as ast

GRAMMAR = {
    "CALL": r"{NAME}\(({NAME}(, *{NAME})*)?\)",
    "EVENT": "start|end|success|(start of |end of )?{CALL}",
    "DURATION": "{NUMBER} (s|ms|min)|{INTEGER} frames?( @ {NUMBER} Hz)?|{NAME}",
    "QUANTITY": "-?{NUMBER}( ?{UNIT})?",
    "REFERENCE": r"-?{NAME}(\({NAME}\))?",
    "LIMIT": "(>=|<=|>|<) ?({QUANTITY}|{REFERENCE})",
    "COUNT": "at (least|most) {INTEGER} {NAME}",
    "ATOM": "{CALL}( since {EVENT})?",
    "SPAN": "((first|last) {DURATION} of )*"
    "(episode|{NAME}|{CALL}|{DURATION} (before|after) {EVENT}|from {EVENT} to {EVENT})"
    "( while {CALL})*",
    "ROLE": "(every )?{KIND}( tagged {NAME})?( except {NAME}(, *{NAME})*)?",
}
"""Production → its words, and other productions in braces. | or, ? perhaps, * any number of times."""

GONE_ATOMS = {
    r"^once\b": 'a [state.NAME] that is latched (when, until = "end"), or the span "DUR after end of state(role, …)"',
    r"^always\b": 'a [state.NAME] with for = "DUR"',
    r" since\[": '"from start of b(role, …) to end of a(role, …)", or a [state.NAME] with when and until',
    r"\) iff ": "any = [{ both true }, { both false }]",
    r"\) xor ": "any = [{ one true, the other false }, { the other way round }]",
}
"""What conditions could say once → what says it now."""

ROLE_KINDS = (
    "object", "surface", "container", "fixture", "body", "link", "gripper", "region", "joint",
)  # fmt: skip
NAME = r"[a-z][a-z0-9_]*"
NUMBER = r"[0-9]+(?:\.[0-9]+)?"
UNIT = "|".join(sorted((re.escape(u) for u in UNIT_DIMENSION), key=len, reverse=True))
TIME_UNITS = tuple(DIMENSIONS["time"])
_TERMINALS = {
    "NAME": NAME, "NUMBER": NUMBER, "INTEGER": "[0-9]+", "UNIT": UNIT, "KIND": "|".join(ROLE_KINDS)
}  # fmt: skip
BODY = r"""(?:[A-Za-z_][\w.:/-]*|"[^"]+"|'[^']+')"""
"""Name of a body as other simulators give them, or any name in quotes."""
QUERY = rf"({NAME})\((?:{BODY}(?:, *{BODY})*)?\)"

DEEPEST = 20
"""Spans that may lie within one another."""

_EXPECTED = {
    "CALL": ("a call", "name(role, …)"),
    "EVENT": (
        "an event",
        "start, end, success, state(role, …), start of state(…), end of state(…)",
    ),
    "DURATION": ("a duration", '"0.5 s", "3 frames", "3 frames @ 120 Hz", or a parameter'),
    "QUANTITY": ("a quantity", "a number with a unit: " + ", ".join(UNIT_DIMENSION)),
    "LIMIT": ("a limit", '">= 2 cm": one of >= <= > <, then a value'),
    "COUNT": ("a count", '"at least 2 role", "at most 1 role"'),
    "SPAN": (
        "a span",
        "episode, a phase, state(…), first|last DUR of SPAN, DUR before|after EVENT, "
        "from EVENT to EVENT, and any of them while state(…)",
    ),
    "ROLE": (
        "what may play a role",
        f"[every] {'|'.join(ROLE_KINDS)} [tagged TAG] [except role, …]",
    ),
}
"""Production → what it is called, and what would do."""

_remembered = lru_cache(4096)
"""Rules say the same again and again; nodes are never changed."""


class GrammarError(ValueError):
    """A string that is not in the grammar.

    Attributes:
        what: what was expected and found.
        allowed: examples or the grammar of what would do.
    """

    def __init__(self, what: str, allowed: str) -> None:
        super().__init__(what)
        self.what, self.allowed = what, allowed


@cache
def pattern(production: str) -> str:
    """The regular expression of a production of ``GRAMMAR``, as editors need it."""
    text = _TERMINALS.get(production)
    if text is None:
        text = re.sub(r"(?<!\\)\(", "(?:", GRAMMAR[production])
        text = re.sub(r"\{(\w+)\}", lambda name: pattern(name[1]), text)
    return f"(?:{text})"


@cache
def _compiled(production: str) -> re.Pattern[str]:
    """A production, with a group for each of its parentheses and braces, in their order."""
    return re.compile(
        re.sub(r"\{(\w+)\}", lambda name: f"({pattern(name[1])})", GRAMMAR[production])
    )


def _matched(production: str, text: str) -> re.Match[str]:
    """The parts of a string. Raises GrammarError."""
    match = _compiled(production).fullmatch(text)
    if match is None:
        raise _refused(production, text)
    return match


def _refused(production: str, text: str) -> GrammarError:
    noun, allowed = _EXPECTED[production]
    return GrammarError(f"{text!r} is not {noun}", allowed)


# ---- numbers


def _number(digits: str | float, unit: str = "") -> float:
    """A number in SI. Raises GrammarError for one that is not finite."""
    try:
        number = finite(digits)
        return finite(in_si(number, unit)) if unit else number
    except ValueError as error:
        raise GrammarError(f"{_short(digits)} is {error}", FINITE) from None


def _few(digits: str | float, unit: str = "") -> float:
    """A number of seconds, frames or things: one that can be counted. Raises GrammarError."""
    number = _number(digits, unit)
    if number > LONGEST:
        what = f"{_short(digits)} {unit}".rstrip() + " are too many"
        raise GrammarError(what, f"at most {LONGEST:.0e}")
    return number


def _short(digits: str | float) -> str:
    return "this" if isinstance(digits, int) else shortened(str(digits), 40)


def quantity(value: str | float) -> ast.Quantity:
    """``"8 cm"`` → 0.08 m. A bare number, or one in %, is a ratio. Raises GrammarError."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return ast.Quantity(_number(value), "ratio", str(value))
    _, _, unit = _matched("QUANTITY", str(value)).groups()
    number = str(value).removesuffix(unit or "").rstrip()
    return ast.Quantity(_number(number, unit or ""), UNIT_DIMENSION.get(unit, "ratio"), str(value))


def setting(value: str | float) -> ast.Setting:
    """The value of a ``[param]``: a quantity, or a duration if it is a time or in frames."""
    if isinstance(value, str) and value[:1].isdigit() and _compiled("DURATION").fullmatch(value):
        return cast("ast.Duration", duration(value))
    number = quantity(value)
    if number.dimension != "time":
        return number
    if number.value < 0:
        raise GrammarError(f"{value!r} lasts less than no time", '"0.5 s", "3 frames @ 120 Hz"')
    return ast.Duration(number.value, text=number.text)


@_remembered
def limit(text: str) -> ast.Limit:
    """``">= 8 cm"``, ``"< zone_reach"``, ``"<= -drop"``, ``"<= max_tilt(target)"``."""
    match = re.match("(>=|<=|>|<) ?(?=.)", text)
    if match is None:
        raise _refused("LIMIT", text)
    first = match.end()
    return ast.Limit(cast(Any, match[1]), value_of(text[first:], first), text)


def value_of(text: str, first: int = 0) -> ast.Value:
    """``"8 cm"``, ``"-drop"``, ``"max_tilt(target)"``; ``first`` is where it stands in its string."""
    match = _compiled("REFERENCE").fullmatch(text)
    if match is None:
        return quantity(text)
    name, _, role = match.groups()
    at, negative = (first + match.start(1), first + match.start(3)), text.startswith("-")
    if role is None:
        return ast.Parameter(name, negative, at[:1])
    return ast.Column(name, role, negative, at)


def count(text: str) -> tuple[Literal["least", "most"], int, str]:
    """``"at least 2 fruit"`` → ("least", 2, "fruit")."""
    bound, number, role = _matched("COUNT", text).groups()
    return cast(Any, bound), int(_few(number)), role


def operand(value: str | float) -> ast.SignalAtom | ast.Quantity | ast.Parameter:
    """Parse an operand of a computed signal: ``"speed(a)"``, ``"2 cm"``, ``0.5``, ``"[-]param"``."""
    if isinstance(value, str) and "(" in value:
        return atom(value)
    found = value_of(value) if isinstance(value, str) else quantity(value)
    return cast("ast.Quantity | ast.Parameter", found)


# ---- time


@_remembered
def duration(text: str, first: int = 0) -> ast.Duration | ast.Parameter:
    """``"0.5 s"``, ``"3 frames"``, ``"3 frames @ 120 Hz"`` or the name of a parameter."""
    number, unit, frames, _, rate, name = _matched("DURATION", text).groups()
    if name:
        return ast.Parameter(name, at=(first,))
    if unit:
        return ast.Duration(_few(number, unit), text=text)
    if not rate:
        return ast.Duration(_few(frames), frames=True, text=text)
    if _number(rate) <= 0:
        raise GrammarError(f"{text!r}: the rate must be positive", '"3 frames @ 120 Hz"')
    seconds = _few(_few(frames) / _number(rate))
    return ast.Duration(seconds, least=2 if _few(frames) > 1 else 1, text=text)


@_remembered
def call(text: str, first: int = 0) -> ast.Call:
    """``"clearance(target, protected)"``. Raises GrammarError."""
    match = _matched("CALL", text)
    args = [
        (one[0], first + match.start(2) + one.start()) for one in re.finditer(NAME, match[2] or "")
    ]
    return ast.Call(match[1], tuple(name for name, _ in args), (first, *(at for _, at in args)))


@_remembered
def event(text: str, first: int = 0) -> ast.Event:
    """``"success"``, ``"end of held(a)"``, ``"committed(a)"``. Raises GrammarError."""
    match = _matched("EVENT", text)
    edge, state = match.groups()
    if state is None:
        return ast.Event(cast(Any, text), text=text)
    edge = cast(Any, edge and edge.removesuffix(" of "))
    return ast.Event("state", call(state, first + match.start(2)), edge, text)


@_remembered
def span(text: str) -> ast.Span:
    """``"last 1 s of hold"``, ``"from start to success"``, …. Raises GrammarError."""
    if len(re.findall(r" while |(?:^| of )(?:first|last) ", text)) > DEEPEST:
        raise GrammarError(
            f"parts of parts of a span, more than {DEEPEST} deep",
            "a phase declared under [phase.NAME] and named here",
        )
    match = _matched("SPAN", text)
    node, (first, last) = _innermost(match), match.span(4)
    parts = re.finditer(f"(first|last) ({pattern('DURATION')}) of ", text[:first])
    for part in reversed(list(parts)):
        node = ast.Part(cast(Any, part[1]), duration(part[2], part.start(2)), node)
    for state in re.finditer(f" while ({pattern('CALL')})", text[last:]):
        node = ast.While(node, call(state[1], last + state.start(1)))
    return node


def _innermost(match: re.Match[str]) -> ast.Span:
    """What the parts of a span are parts of; phases with roles are told from states when names are known."""
    *_, name, state, lasting, side, event_, begin, stop, _, _ = match.groups()
    at = match.start
    if side:
        return ast.Around(cast(Any, side), duration(lasting, at(7)), event(event_, at(9)))
    if begin:
        return ast.FromTo(event(begin, at(10)), event(stop, at(11)))
    if state:
        return ast.StateSpan(call(state, at(6)))
    return ast.PhaseSpan(ast.Call(name, (), (at(5),))) if name else ast.Whole()


@_remembered
def atom(text: str) -> ast.SignalAtom:
    """The left side of an entry: ``"displacement(cup) since success"``. Raises GrammarError."""
    match = _compiled("ATOM").fullmatch(text)
    if match is not None:
        since = event(match[3], match.start(3)) if match[3] else None
        return ast.SignalAtom(call(match[1]), (), since)
    for gone, instead in GONE_ATOMS.items():
        if re.search(gone, text):
            raise GrammarError(f"{text!r} is not in the language any more", instead)
    if head := re.fullmatch(rf"{NAME}\([^)]*\) since (.+)", text):
        event(head[1])
    foreign = re.match(QUERY, text)
    if foreign is None:
        raise GrammarError(
            f"{text!r} is neither a signal nor a state",
            'name(role, …), optionally "since EVENT"; or "any"',
        )
    bodies = re.findall(BODY, text[foreign.end(1) : foreign.end()])
    names = [name for name in bodies if not re.fullmatch(NAME, name)]
    if not names:
        raise GrammarError(f"{text!r} does not end there", "name(role, …) since EVENT")
    raise GrammarError(
        f"{', '.join(names)} cannot name a role: rules are about roles, which bodies play",
        'name(role, …) with roles as "target", bound in a bind file or a header: roles = '
        f'{{ target = "{_bare(names[0])}" }}',
    )


def query(text: str) -> ast.Call:
    """``"lift(cubeA)"``, ``"clearance(milk-1, 'the tray')"``: bodies by their names. Raises GrammarError."""
    match = re.fullmatch(QUERY, text)
    if match is None:
        raise GrammarError(
            f"{text!r} is not a call",
            "name(body, …): letters, digits and _ . : / - as they are, any other name in quotes",
        )
    return ast.Call(match[1], tuple(_bare(one) for one in re.findall(BODY, text[match.end(1) :])))


def _bare(name: str) -> str:
    return name[1:-1] if name[0] in "\"'" else name


def role(text: str) -> ast.RoleSpec:
    """``"object"``, ``"every object tagged fragile except target"``. Raises GrammarError."""
    if re.search(r" (un)?named\b", text):
        allowed = (
            "instead of named and unnamed: except role, … or a tag from a bind file's [body.NAME]"
        )
        raise GrammarError(
            f"{text!r} is not what may play a role", f"{_EXPECTED['ROLE'][1]}; {allowed}"
        )
    every, kind, _, tag, others, *_ = _matched("ROLE", text).groups()
    excluding = re.findall(NAME, others.removeprefix(" except ")) if others else ()
    return ast.RoleSpec(kind, bool(every), tag, tuple(excluding), text)
