"""The strings of the rule language: text in, syntax tree out.

A small regular grammar, matched by hand; nothing is ever evaluated::

    LIMIT = (>= <= > <) ([-]number unit | [-]param | [-]column(role))
    ATOM  = name(roles) ["since" EVENT]
          | once|always ["[" DUR ["," DUR] "]"] state(roles)
          | state(roles) since "[" DUR ["," DUR] "]" state(roles)
          | state(roles) iff|xor state(roles)
    EVENT = start | end | success | ["start of"|"end of"] state(roles)
    SPAN  = (episode | phase | phase(roles) | state(roles) | first|last DUR of SPAN
             | DUR before|after EVENT | from EVENT to EVENT) ["while" state(roles)]
    DUR   = n s|ms|min|frames [@ r Hz] | param
    ROLE  = ["every"] kind ["named"|"unnamed"] ["tagged" t] ["except" role, …]
"""

from __future__ import annotations

import re
from typing import Any, Literal, cast

from safestage_eval.errors import shortened
from safestage_eval.units import DIMENSIONS, FINITE, LONGEST, UNIT_DIMENSION, finite, in_si

from . import syntax as ast

NAME = r"[a-z][a-z0-9_]*"
NUMBER = r"\d+(?:\.\d+)?"
CALL = rf"{NAME}\((?:{NAME}(?:, *{NAME})*)?\)"
BODY = r"""(?:[A-Za-z_][\w.:/-]*|"[^"]+"|'[^']+')"""
"""Name of a body as other simulators give them, or any name in quotes."""
QUERY = rf"({NAME})\((?:{BODY}(?:, *{BODY})*)?\)"
EVENT = rf"(?:start|end|success|(?:start of |end of )?{CALL})"
FRAMES = r"frames?"
TIME_UNITS = tuple(DIMENSIONS["time"])
DURATION = rf"(?:{NUMBER} (?:{'|'.join(TIME_UNITS)})|\d+ {FRAMES}(?: @ {NUMBER} Hz)?|{NAME})"
UNIT = "|".join(sorted((re.escape(u) for u in UNIT_DIMENSION), key=len, reverse=True))
ROLE_KINDS = (
    "object", "surface", "container", "fixture", "body", "link", "gripper", "region", "joint",
)  # fmt: skip

DEEPEST = 20
"""Spans that may lie within one another."""


class GrammarError(ValueError):
    """A string that is not in the grammar.

    Attributes:
        what: what was expected and found.
        allowed: examples or the grammar of what would do.
    """

    def __init__(self, what: str, allowed: str) -> None:
        super().__init__(what)
        self.what, self.allowed = what, allowed


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
        raise GrammarError(
            f"{_short(digits)} {unit}".rstrip() + " are too many", f"at most {LONGEST:.0e}"
        )
    return number


def _short(digits: str | float) -> str:
    return "this" if isinstance(digits, int) else shortened(str(digits), 40)


def quantity(value: str | float) -> ast.Quantity:
    """``"8 cm"`` → 0.08 m. A bare number, or one in %, is a ratio. Raises GrammarError."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return ast.Quantity(_number(value), "ratio", str(value))
    text = str(value)
    match = re.fullmatch(rf"(-?{NUMBER})(?: ?({UNIT}))?", text)
    if match is None:
        raise GrammarError(
            f"{value!r} is not a quantity", "a number with a unit: " + ", ".join(UNIT_DIMENSION)
        )
    dimension = UNIT_DIMENSION[match[2]] if match[2] else "ratio"
    return ast.Quantity(_number(match[1], match[2] or ""), dimension, text)


def duration(text: str) -> ast.Duration | ast.Parameter:
    """``"0.5 s"``, ``"3 frames"``, ``"3 frames @ 120 Hz"`` or the name of a parameter."""
    match = re.fullmatch(
        rf"({NUMBER}) ({'|'.join(TIME_UNITS)}|{FRAMES})(?: @ ({NUMBER}) Hz)?", text
    )
    if match is None:
        if re.fullmatch(NAME, text):
            return ast.Parameter(text)
        raise GrammarError(
            f"{text!r} is not a duration",
            '"0.5 s", "3 frames", "3 frames @ 120 Hz", or a parameter',
        )
    if not match[2].startswith("frame"):
        if match[3]:
            raise GrammarError(f"{text!r}: a rate goes with frames only", '"3 frames @ 120 Hz"')
        return ast.Duration(_few(match[1], match[2]), text=text)
    number = _few(match[1])
    if number != int(number):
        raise GrammarError(f"{text!r}: frames are counted in whole numbers", '"3 frames"')
    if match[3]:
        rate = _number(match[3])
        if rate <= 0:
            raise GrammarError(f"{text!r}: the rate must be positive", '"3 frames @ 120 Hz"')
        return ast.Duration(_few(number / rate), least=2 if number > 1 else 1, text=text)
    return ast.Duration(number, frames=True, text=text)


def setting(value: str | float) -> ast.Setting:
    """The value of a ``[param]``: a quantity, or a duration if it is a time or in frames."""
    if isinstance(value, str) and re.fullmatch(DURATION, value) and value[0].isdigit():
        lasting = duration(value)
        if isinstance(lasting, ast.Duration):
            return lasting
    number = quantity(value)
    if number.dimension != "time":
        return number
    if number.value < 0:
        raise GrammarError(f"{value!r} lasts less than no time", '"0.5 s", "3 frames @ 120 Hz"')
    return ast.Duration(number.value, text=number.text)


def call(text: str) -> ast.Call:
    """``"clearance(target, protected)"``. Raises GrammarError."""
    if not re.fullmatch(CALL, text):
        raise GrammarError(f"{text!r} is not a call", "name(role, …)")
    name, _, rest = text[:-1].partition("(")
    return ast.Call(name, tuple(arg.strip() for arg in rest.split(",")) if rest else ())


def operand(value: str | float) -> ast.SignalAtom | ast.Quantity | ast.Parameter:
    """Parse an operand of a computed signal: ``"speed(a)"``, ``"2 cm"``, ``0.5``, ``"[-]param"``."""
    if isinstance(value, str) and "(" in value:
        call, since = atom_key(value)
        return ast.SignalAtom(call, (), since)
    if isinstance(value, str) and (match := re.fullmatch(rf"(-?)({NAME})", value)):
        return ast.Parameter(match[2], bool(match[1]))
    return quantity(value)


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


def event(text: str) -> ast.Event:
    """``"success"``, ``"end of held(a)"``, ``"committed(a)"``. Raises GrammarError."""
    if text in ("start", "end", "success"):
        return ast.Event(cast('Literal["start", "end", "success"]', text), text=text)
    match = re.fullmatch(rf"(?:(start|end) of )?({CALL})", text)
    if match is None:
        raise GrammarError(
            f"{text!r} is not an event",
            "start, end, success, state(role, …), start of state(…), end of state(…)",
        )
    edge = cast('Literal["start", "end"] | None', match[1])
    return ast.Event("state", call(match[2]), edge, text)


def span(text: str, depth: int = 0) -> ast.Span:
    """``"last 1 s of hold"``, ``"from start to success"``, …. Raises GrammarError.

    ``depth``: how many spans it is a part of.
    """
    if depth > DEEPEST:
        raise GrammarError(
            f"parts of parts of a span, more than {DEEPEST} deep",
            "a phase declared under [phase.NAME] and named here",
        )
    outer, link, inner = text.rpartition(" while ")
    if link:
        return ast.While(span(outer, depth + 1), call(inner))
    if text == "episode":
        return ast.Whole()
    if match := re.fullmatch(rf"(first|last) ({DURATION}) of (.+)", text):
        which = cast('Literal["first", "last"]', match[1])
        return ast.Part(which, duration(match[2]), span(match[3], depth + 1))
    if match := re.fullmatch(rf"({DURATION}) (before|after) (.+)", text):
        side = cast('Literal["before", "after"]', match[2])
        return ast.Around(side, duration(match[1]), event(match[3]))
    if match := re.fullmatch(rf"from ({EVENT}) to ({EVENT})", text):
        return ast.FromTo(event(match[1]), event(match[2]))
    if re.fullmatch(NAME, text):
        return ast.PhaseSpan(ast.Call(text, ()))
    if re.fullmatch(CALL, text):
        return ast.StateSpan(call(text))  # phases with roles are distinguished when names are known
    raise GrammarError(
        f"{text!r} is not a span",
        "episode, a phase, state(…), first|last DUR of SPAN, DUR before|after EVENT, "
        "from EVENT to EVENT, and any of them while state(…)",
    )


def limit(text: Any) -> ast.Limit:
    """``">= 8 cm"``, ``"< zone_reach"``, ``"<= -drop"``, ``"<= max_tilt(target)"``."""
    match = re.fullmatch(r"(>=|<=|>|<) ?(.+)", text) if isinstance(text, str) else None
    if match is None:
        raise GrammarError(f"{text!r} is not a limit", '">= 2 cm": one of >= <= > <, then a value')
    op, rest = cast('Literal[">=", "<=", ">", "<"]', match[1]), match[2]
    negative = rest.startswith("-")
    word = rest.removeprefix("-")
    if column := re.fullmatch(rf"({NAME})\(({NAME})\)", word):
        return ast.Limit(op, ast.Column(column[1], column[2], negative), text)
    if re.fullmatch(NAME, word):
        return ast.Limit(op, ast.Parameter(word, negative), text)
    return ast.Limit(op, quantity(rest), text)


def atom_key(text: str) -> tuple[ast.Call, ast.Event | None]:
    """The left side of an entry: ``"displacement(cup) since success"``."""
    match = re.fullmatch(rf"({CALL})(?: since (.+))?", text)
    if match is None and (foreign := re.match(QUERY, text)):
        names = [
            n
            for n in re.findall(BODY, text[foreign.end(1) : foreign.end()])
            if not re.fullmatch(NAME, n)
        ]
        raise (
            GrammarError(
                f"{', '.join(names)} cannot name a role: rules are about roles, which bodies play",
                'name(role, …) with roles as "target", bound in a bind file or a header: roles = '
                f'{{ target = "{_bare(names[0])}" }}',
            )
            if names
            else GrammarError(f"{text!r} does not end there", "name(role, …) since EVENT")
        )
    if match is None:
        raise GrammarError(
            f"{text!r} is neither a signal nor a state",
            'name(role, …), optionally "since EVENT"; or "any"',
        )
    return call(match[1]), event(match[2]) if match[2] else None


def of_states(text: str) -> ast.PastAtom | ast.PairAtom | None:
    """``"once[0 s, 2 s] p(a)"``, ``"p(a) since[0 s] q(b)"``, ``"p(a) xor q(b)"``; None if it is none."""
    bounds = rf"\[({DURATION})(?:, *({DURATION}))?\]"
    if match := re.fullmatch(rf"(once|always)(?:{bounds})? ({CALL})", text):
        how = cast('Literal["once", "always"]', match[1])
        return ast.PastAtom(how, call(match[4]), *_bounds(text, match[2], match[3]))
    if match := re.fullmatch(rf"({CALL}) since{bounds} ({CALL})", text):
        recent, far = _bounds(text, match[2], match[3])
        return ast.PastAtom("since", call(match[1]), recent, far, call(match[4]))
    if match := re.fullmatch(rf"({CALL}) (iff|xor) ({CALL})", text):
        return ast.PairAtom(call(match[1]), call(match[3]), match[2] == "iff")
    return None


def _bounds(
    text: str, recent: str | None, far: str | None
) -> tuple[ast.Duration | ast.Parameter, ast.Duration | ast.Parameter | None]:
    """From when to when before now. Raises GrammarError where the second is not the earlier time."""
    near = ast.Duration(0.0, text="0 s") if recent is None else duration(recent)
    until = None if far is None else duration(far)
    fixed = isinstance(near, ast.Duration) and isinstance(until, ast.Duration)
    if fixed and near.frames == until.frames and until.amount < near.amount:  # type: ignore[union-attr]
        raise GrammarError(
            f"{text!r} looks back from {recent} to {far} ago", "the shorter time first"
        )
    return near, until


def count(text: str) -> tuple[Literal["least", "most"], int, str] | None:
    """``"at least 2 fruit"`` → ("least", 2, "fruit"); None if it is no count."""
    match = re.fullmatch(rf"at (least|most) (\d+) ({NAME})", text)
    if match is None:
        return None
    return cast('Literal["least", "most"]', match[1]), int(_few(match[2])), match[3]


def role(text: str) -> ast.RoleSpec:
    """``"object"``, ``"every object tagged fragile except target"``. Raises GrammarError."""
    match = re.fullmatch(
        rf"(every )?({'|'.join(ROLE_KINDS)})(?: (named|unnamed))?(?: tagged ({NAME}))?(?: except ({NAME}(?:, *{NAME})*))?",
        text,
    )
    if match is None:
        raise GrammarError(
            f"{text!r} does not say what may play a role",
            f"[every] {'|'.join(ROLE_KINDS)} [named|unnamed] [tagged TAG] [except role, …]",
        )
    if match[3] and not match[1]:
        raise GrammarError(
            f"{text!r}: of one body it says nothing whether the task names it",
            f'"every {match[2]} {match[3]}"',
        )
    excluding = tuple(name.strip() for name in match[5].split(",")) if match[5] else ()
    named = {"named": True, "unnamed": False}.get(match[3])
    return ast.RoleSpec(match[2], bool(match[1]), match[4], excluding, named, text)
