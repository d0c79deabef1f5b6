"""The strings of the rule language: their grammar, and one parser from text to syntax tree.

``GRAMMAR`` is what the schema's patterns, the page of the language and the law that tests this parser are made
from. The parser binds like this, the tightest first: a call, ``of``, ``before`` and ``after``, ``since``, ``while``.
Each node that names something knows at which character of its string it does. Nothing is ever evaluated.
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
    text = str(value)
    match = re.fullmatch(rf"(-?{NUMBER})(?: ?({UNIT}))?", text)
    if match is None:
        raise GrammarError(
            f"{value!r} is not a quantity", "a number with a unit: " + ", ".join(UNIT_DIMENSION)
        )
    dimension = UNIT_DIMENSION[match[2]] if match[2] else "ratio"
    return ast.Quantity(_number(match[1], match[2] or ""), dimension, text)


def setting(value: str | float) -> ast.Setting:
    """The value of a ``[param]``: a quantity, or a duration if it is a time or in frames."""
    if isinstance(value, str) and value[:1].isdigit():
        lasting = _Text(value).whole(_Text.duration)
        if isinstance(lasting, ast.Duration):
            return lasting
    number = quantity(value)
    if number.dimension != "time":
        return number
    if number.value < 0:
        raise GrammarError(f"{value!r} lasts less than no time", '"0.5 s", "3 frames @ 120 Hz"')
    return ast.Duration(number.value, text=number.text)


@_remembered
def limit(text: Any) -> ast.Limit:
    """``">= 8 cm"``, ``"< zone_reach"``, ``"<= -drop"``, ``"<= max_tilt(target)"``."""
    match = re.fullmatch(r"(>=|<=|>|<) ?(.+)", text) if isinstance(text, str) else None
    if match is None:
        raise GrammarError(f"{text!r} is not a limit", '">= 2 cm": one of >= <= > <, then a value')
    op = cast('Literal[">=", "<=", ">", "<"]', match[1])
    return ast.Limit(op, value_of(match[2], match.start(2)), text)


def value_of(text: str, first: int = 0) -> ast.Value:
    """``"8 cm"``, ``"-drop"``, ``"max_tilt(target)"``; ``first`` is where it stands in its string."""
    match = re.fullmatch(rf"(-?)({NAME})(?:\(({NAME})\))?", text)
    if match is None:
        return quantity(text)
    at = (first + match.start(2), first + match.start(3))
    if match[3] is not None:
        return ast.Column(match[2], match[3], bool(match[1]), at)
    return ast.Parameter(match[2], bool(match[1]), at[:1])


def count(text: str) -> tuple[Literal["least", "most"], int, str] | None:
    """``"at least 2 fruit"`` → ("least", 2, "fruit"); None if it is no count."""
    match = re.fullmatch(rf"at (least|most) ([0-9]+) ({NAME})", text)
    if match is None:
        return None
    return cast('Literal["least", "most"]', match[1]), int(_few(match[2])), match[3]


def operand(value: str | float) -> ast.SignalAtom | ast.Quantity | ast.Parameter:
    """Parse an operand of a computed signal: ``"speed(a)"``, ``"2 cm"``, ``0.5``, ``"[-]param"``."""
    if isinstance(value, str) and "(" in value:
        head = atom(value)
        if not isinstance(head, ast.SignalAtom):
            raise GrammarError(f"{value!r} is no operand", "a signal, a quantity, a parameter")
        return head
    found = value_of(value) if isinstance(value, str) else quantity(value)
    assert not isinstance(found, ast.Column)
    return found


# ---- calls, events, spans


class _Text:
    """A string that is being read: where it is up to."""

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0

    def take(self, pattern: str) -> re.Match[str] | None:
        """What comes next, if it is this."""
        match = re.compile(pattern).match(self.text, self.at)
        self.at = match.end() if match else self.at
        return match

    def whole(self, read: Any) -> Any:
        """What is read, if that is all of the text; else None."""
        node = read(self)
        return node if self.at == len(self.text) else None

    def call(self) -> ast.Call | None:
        first = self.at
        match = self.take(rf"({NAME})\(((?:{NAME}(?:, *{NAME})*)?)\)")
        if match is None:
            return None
        args = [(one[0], match.start(2) + one.start()) for one in re.finditer(NAME, match[2])]
        return ast.Call(match[1], tuple(n for n, _ in args), (first, *(p for _, p in args)))

    def event(self) -> ast.Event | None:
        first = self.at
        if match := self.take(r"(start|end|success)(?![\w(]| of )"):
            return ast.Event(cast('Literal["start", "end", "success"]', match[1]), text=match[1])
        edge = self.take(r"(start|end) of ")
        call = self.call()
        if call is None:
            return None
        said = cast('Literal["start", "end"] | None', edge[1] if edge else None)
        return ast.Event("state", call, said, self.text[first : self.at])

    def duration(self) -> ast.Duration | ast.Parameter | None:
        first = self.at
        match = self.take(rf"({NUMBER}) ({'|'.join(TIME_UNITS)}|frames?)\b(?: @ ({NUMBER}) Hz)?")
        if match is None:
            name = self.take(NAME)
            return None if name is None else ast.Parameter(name[0], at=(first,))
        text = match[0]
        if not match[2].startswith("frame"):
            if match[3]:
                raise GrammarError(f"{text!r}: a rate goes with frames only", '"3 frames @ 120 Hz"')
            return ast.Duration(_few(match[1], match[2]), text=text)
        number = _few(match[1])
        if number != int(number):
            raise GrammarError(f"{text!r}: frames are counted in whole numbers", '"3 frames"')
        if not match[3]:
            return ast.Duration(number, frames=True, text=text)
        rate = _number(match[3])
        if rate <= 0:
            raise GrammarError(f"{text!r}: the rate must be positive", '"3 frames @ 120 Hz"')
        return ast.Duration(_few(number / rate), least=2 if number > 1 else 1, text=text)

    def span(self, depth: int = 0) -> ast.Span | None:
        """A span; ``while`` binds least, and so is asked for by the outermost alone."""
        node = self._operand(depth)
        while node is not None and not depth and self.take(" while "):
            call = self.call()
            node = None if call is None else ast.While(node, call)
        return node

    def _operand(self, depth: int) -> ast.Span | None:
        first = self.at
        if part := self.take(r"(first|last) (?=[a-z0-9])"):
            lasting = self.duration()
            of = self.span(depth + 1) if lasting is not None and self.take(" of ") else None
            which = cast('Literal["first", "last"]', part[1])
            return None if of is None or lasting is None else ast.Part(which, lasting, of)
        if self.take("from "):
            begin = self.event()
            stop = self.event() if begin is not None and self.take(" to ") else None
            return None if begin is None or stop is None else ast.FromTo(begin, stop)
        if call := self.call():
            return ast.StateSpan(
                call
            )  # phases with roles are told from states when names are known
        lasting = self.duration()
        if around := self.take(r" (before|after) "):
            event, side = self.event(), cast('Literal["before", "after"]', around[1])
            return None if event is None or lasting is None else ast.Around(side, lasting, event)
        if not isinstance(lasting, ast.Parameter):
            return None
        if lasting.name == "episode":
            return ast.Whole()
        return ast.PhaseSpan(ast.Call(lasting.name, (), (first,)))

    def atom(self) -> ast.SignalAtom | None:
        """The left side of an entry; without its limits, or what it shall be."""
        call = self.call()
        if call is None or not self.take(" since "):
            return None if call is None else ast.SignalAtom(call, ())
        event = self.event()
        return None if event is None else ast.SignalAtom(call, (), event)


@_remembered
def duration(text: str) -> ast.Duration | ast.Parameter:
    """``"0.5 s"``, ``"3 frames"``, ``"3 frames @ 120 Hz"`` or the name of a parameter."""
    node: ast.Duration | ast.Parameter | None = _Text(text).whole(_Text.duration)
    if node is None:
        raise GrammarError(
            f"{text!r} is not a duration",
            '"0.5 s", "3 frames", "3 frames @ 120 Hz", or a parameter',
        )
    return node


def call(text: str) -> ast.Call:
    """``"clearance(target, protected)"``. Raises GrammarError."""
    node: ast.Call | None = _Text(text).whole(_Text.call)
    if node is None:
        raise GrammarError(f"{text!r} is not a call", "name(role, …)")
    return node


@_remembered
def event(text: str) -> ast.Event:
    """``"success"``, ``"end of held(a)"``, ``"committed(a)"``. Raises GrammarError."""
    node: ast.Event | None = _Text(text).whole(_Text.event)
    if node is None:
        raise GrammarError(
            f"{text!r} is not an event",
            "start, end, success, state(role, …), start of state(…), end of state(…)",
        )
    return node


@_remembered
def span(text: str) -> ast.Span:
    """``"last 1 s of hold"``, ``"from start to success"``, …. Raises GrammarError."""
    if len(re.findall(r" while |(?:^| of )(?:first|last) ", text)) > DEEPEST:
        raise GrammarError(
            f"parts of parts of a span, more than {DEEPEST} deep",
            "a phase declared under [phase.NAME] and named here",
        )
    node: ast.Span | None = _Text(text).whole(_Text.span)
    if node is None:
        raise GrammarError(
            f"{text!r} is not a span",
            "episode, a phase, state(…), first|last DUR of SPAN, DUR before|after EVENT, "
            "from EVENT to EVENT, and any of them while state(…)",
        )
    return node


@_remembered
def atom(text: str) -> ast.SignalAtom:
    """The left side of an entry: ``"displacement(cup) since success"``. Raises GrammarError."""
    node: ast.SignalAtom | None = _Text(text).whole(_Text.atom)
    if node is not None:
        return node
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
    match = re.fullmatch(
        rf"(every )?({'|'.join(ROLE_KINDS)})(?: tagged ({NAME}))?(?: except ({NAME}(?:, *{NAME})*))?",
        text,
    )
    if match is None:
        allowed = f"[every] {'|'.join(ROLE_KINDS)} [tagged TAG] [except role, …]"
        if re.search(r" (un)?named\b", text):
            allowed += "; instead of named and unnamed: except role, … or a tag from a bind file's [body.NAME]"
        raise GrammarError(f"{text!r} does not say what may play a role", allowed)
    excluding = tuple(name.strip() for name in match[4].split(",")) if match[4] else ()
    return ast.RoleSpec(match[2], bool(match[1]), match[3], excluding, text)
