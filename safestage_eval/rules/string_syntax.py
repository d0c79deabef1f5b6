"""The abstract syntax of the strings of rule files: quantities, limits, events, conditions, spans, roles.

``syntax`` has the tables, and hands these on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class Quantity:
    """A number with its dimension: ``value`` in SI (``"8 cm"`` → 0.08, "length")."""

    value: float
    dimension: str
    text: str = field(default="", compare=False)


@dataclass(frozen=True)
class Duration:
    """A length of time: ``amount`` seconds, or frames of the trace when ``frames`` is true.

    ``"3 frames @ 120 Hz"`` is 0.025 s, and at least 2 samples whatever the trace's rate (``least``),
    because several frames were meant; bare ``"3 frames"`` counts frames of the trace.
    """

    amount: float
    frames: bool = False
    least: int = 1
    text: str = field(default="", compare=False)


Setting = Quantity | Duration
"""The value of a parameter."""

Params = Mapping[str, Setting]
"""Parameter → its value."""


def amount(value: Setting) -> float:
    """The number of a value: SI; seconds or frames for a duration."""
    return value.value if isinstance(value, Quantity) else value.amount


@dataclass(frozen=True)
class Parameter:
    """A reference to ``[param]`` by name, in a limit or as a duration; ``negative`` flips its sign."""

    name: str
    negative: bool = False
    at: tuple[int, ...] = field(default=(), compare=False, repr=False)
    """At which character of its string the name stands."""


@dataclass(frozen=True)
class Column:
    """A reference to a material column of the body that plays ``role``: ``max_tilt(target)``."""

    name: str
    role: str
    negative: bool = False
    at: tuple[int, ...] = field(default=(), compare=False, repr=False)
    """At which character of its string the name stands, and the role."""


Value = Quantity | Parameter | Column


@dataclass(frozen=True)
class Limit:
    """A comparison: ``>= 2 cm``."""

    op: Literal[">=", "<=", ">", "<"]
    value: Value
    text: str = field(default="", compare=False)


@dataclass(frozen=True)
class Call:
    """A name applied to roles: ``clearance(target, protected)``."""

    name: str
    args: tuple[str, ...]
    at: tuple[int, ...] = field(default=(), compare=False, repr=False)
    """At which character of its string the name stands, and each argument."""

    def __str__(self) -> str:
        """Return the call as written in rule files."""
        return f"{self.name}({', '.join(self.args)})"


@dataclass(frozen=True)
class Event:
    """A moment, or the frames of a state where a set of frames is asked for.

    kind ``start``, ``end`` (of the episode), ``success``, or ``state``: then ``call`` names it and
    ``edge`` says whether its beginning, its end, or (None) the bare state is meant.
    """

    kind: Literal["start", "end", "success", "state"]
    call: Call | None = None
    edge: Literal["start", "end"] | None = None
    text: str = field(default="", compare=False)


@dataclass(frozen=True)
class SignalAtom:
    """Limits on a signal; all of them must hold. ``since`` moves its reference to an event.

    As an operand of a derived signal it has no limits.
    """

    call: Call
    limits: tuple[Limit, ...]
    since: Event | None = None


@dataclass(frozen=True)
class StateAtom:
    """A state or relation that must be true (or false)."""

    call: Call
    want: bool


@dataclass(frozen=True)
class CountAtom:
    """``"at least 2 fruit"`` / ``"at most 1 fruit"``: over the bodies that play ``role``."""

    call: Call
    bound: Literal["least", "most"]
    count: int
    role: str


@dataclass(frozen=True)
class PastAtom:
    """A state as it was from ``far`` to ``recent`` ago (since the start if None): ``once[1 s, 2 s] p(a)``.

    ``once`` at some time, ``always`` all the time. ``since``: at some time then ``begun`` held, and
    ``call`` at every sample behind it until now.
    """

    how: Literal["once", "always", "since"]
    call: Call
    recent: Duration | Parameter
    far: Duration | Parameter | None
    begun: Call | None = None
    want: bool = True


@dataclass(frozen=True)
class PairAtom:
    """Two states that hold alike (``p(a) iff q(b)``), or do not (``xor``, or ``want`` false)."""

    call: Call
    other: Call
    want: bool = True


@dataclass(frozen=True)
class AnyOf:
    """At least one of the alternatives holds."""

    alternatives: tuple[Alternative, ...]


Atom = SignalAtom | StateAtom | CountAtom | PastAtom | PairAtom | AnyOf


@dataclass(frozen=True)
class Condition:
    """All atoms hold."""

    atoms: tuple[Atom, ...]


Alternative = Condition | Event


@dataclass(frozen=True)
class Whole:
    """Span: the whole episode."""


@dataclass(frozen=True)
class PhaseSpan:
    """Span: a declared ``[phase.NAME]``, with the roles passed to it."""

    call: Call


@dataclass(frozen=True)
class StateSpan:
    """Span: every run of frames in which a state is true."""

    call: Call


@dataclass(frozen=True)
class Part:
    """Span: the first or last stretch of another span."""

    which: Literal["first", "last"]
    duration: Duration | Parameter
    of: Span


@dataclass(frozen=True)
class Around:
    """Span: a stretch before or after each occurrence of an event."""

    which: Literal["before", "after"]
    duration: Duration | Parameter
    event: Event


@dataclass(frozen=True)
class FromTo:
    """Span: from each occurrence of one event to the next of the other."""

    begin: Event
    stop: Event


@dataclass(frozen=True)
class While:
    """Span: the frames of another span in which a state is true."""

    of: Span
    call: Call


Span = Whole | PhaseSpan | StateSpan | Part | Around | FromTo | While


@dataclass(frozen=True)
class RoleSpec:
    """The bodies that may play a role: ``"every object tagged fragile except target, support"``."""

    kind: str
    every: bool = False
    tag: str | None = None
    excluding: tuple[str, ...] = ()
    named: bool | None = None
    """Only bodies that play some role of the task; false: only those that play none."""
    text: str = field(default="", compare=False)
