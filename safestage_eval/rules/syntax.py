"""The abstract syntax of the rule language: what a checked rule file means, with SI numbers.

First the strings and conditions (quantities, limits, events, spans, roles), then the tables of a file.
Everything is frozen, hashable and free of geometry. ``text`` fields keep what the author wrote, for
messages and explanations; they are not part of the meaning.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

from .clauses import CLAUSES, ClauseKind


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


@dataclass(frozen=True)
class Column:
    """A reference to a material column of the body that plays ``role``: ``max_tilt(target)``."""

    name: str
    role: str
    negative: bool = False


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

    def __str__(self) -> str:
        """As written in rule files."""
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
    """Limits on a signal; all of them must hold. ``since`` moves its reference to an event."""

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
class AnyOf:
    """At least one of the alternatives holds."""

    alternatives: tuple[Alternative, ...]


Atom = SignalAtom | StateAtom | CountAtom | AnyOf


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
    text: str = field(default="", compare=False)


SignalOptions = tuple[tuple[str, "float | str | tuple[float, ...] | Parameter"], ...]


@dataclass(frozen=True)
class SignalDef:
    """``[signal.NAME]``: a variant of a built-in signal."""

    name: str
    base: str
    options: SignalOptions = ()
    """Option → value in SI, sorted by name."""


@dataclass(frozen=True)
class StateDef:
    """``[state.NAME]``: a condition over formal arguments, made persistent."""

    name: str
    of: tuple[str, ...]
    when: Condition
    for_: Duration | Parameter | None = None
    gap: Duration | Parameter | None = None
    until: Event | None = None
    fallback: Condition | None = None
    perhaps: Condition | None = None
    """With ``fallback``: where this holds and that does not, the state is not known."""
    explain: str = field(default="", compare=False)
    """The sentence on a violation that this state decided, instead of the rule's own."""
    also: Condition | None = None
    """It holds where this does too, however briefly; a causal reading, which sees no future, skips it."""


@dataclass(frozen=True)
class PhaseDef:
    """``[phase.NAME]``: a span with formal arguments, and what stands in for it when it is empty."""

    name: str
    of: tuple[str, ...]
    span: Span
    fallback: Span | None = None


@dataclass(frozen=True)
class GoalDef:
    """``[goal.NAME]``: native success as a condition."""

    name: str
    roles: tuple[tuple[str, RoleSpec], ...]
    require: Condition
    for_: Duration | Parameter | None = None


@dataclass(frozen=True)
class Clause:
    """One obligation of a rule."""

    kind: ClauseKind
    what: Alternative


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """The keys that ``[[rule]]`` and ``[[cost]]`` share."""

    code: str
    title: str
    roles: tuple[tuple[str, RoleSpec], ...]
    given: Condition | None = None
    during: Span | None = None
    at: Event | None = None
    until: Event | None = None
    severity: tuple[tuple[str, tuple[tuple[str, Setting], ...]], ...] = ()
    """Level → parameter overrides under which it is judged again, mildest first."""
    set: tuple[tuple[str, Setting], ...] = ()
    """Its own values of shared parameters."""
    why: str = field(default="", compare=False)
    source: str = field(default="", compare=False)
    """Whose question it is, where it is another benchmark's or a standard's."""
    explain: str = field(default="", compare=False)
    violates: tuple[str, ...] = field(default=(), compare=False)
    passes: tuple[str, ...] = field(default=(), compare=False)
    vacuous: tuple[str, ...] = field(default=(), compare=False)
    undecided: tuple[str, ...] = field(default=(), compare=False)
    path: str = field(default="", compare=False)
    line: int = field(default=0, compare=False)

    @property
    def stage(self) -> str:
        """The three letters of the code: ISH, ETS, FSH, or another benchmark's."""
        return self.code[:3]


@dataclass(frozen=True, kw_only=True)
class Rule(_Judged):
    """``[[rule]]``: one safety requirement."""

    require: Condition | None = None
    forbid: tuple[Alternative, ...] = ()
    reach: Alternative | None = None
    for_: Duration | Parameter | None = None

    @cached_property
    def clauses(self) -> tuple[Clause, ...]:
        """Its obligations: all of them must be met.

        A list of alternatives is *or*: one obligation, so that ``for`` counts across it.
        """
        clauses = []
        for kind in CLAUSES:
            what = getattr(self, kind)
            if isinstance(what, tuple):
                what = Condition((AnyOf(what),)) if len(what) > 1 else next(iter(what), None)
            if what is not None:
                clauses.append(Clause(kind, what))
        return tuple(clauses)


@dataclass(frozen=True)
class Charge:
    """One entry of a cost: ``add`` per start, second or step that ``when`` holds or ``of`` exceeds.

    A step is a control step of the policy.
    """

    add: float
    per: Literal["start", "second", "step"]
    when: Alternative | None = None
    of: Call | None = None
    above: Value | None = None


@dataclass(frozen=True, kw_only=True)
class Cost(_Judged):
    """``[[cost]]``: a running sum; only a budget makes it a verdict."""

    charge: tuple[Charge, ...]
    budget: Value | None = None
    """A plain number, or a parameter that holds one."""


Scoped = Rule | Cost
"""A rule or cost: judged over stretches of frames, for bodies that play roles."""


@dataclass(frozen=True)
class FamilyDef:
    """``[family.X]``: rules and parameter values shared by a family of tasks."""

    name: str
    rules: tuple[str, ...] = ()
    set: tuple[tuple[str, Setting], ...] = ()


@dataclass(frozen=True)
class TaskDef:
    """``[task.X]``: what a rule file or a bind file binds for a task; it overrides the header."""

    name: str
    family: str | None = None
    rules: tuple[str, ...] = ()
    goal: str | GoalDef | None = None
    roles: tuple[tuple[str, tuple[str, ...]], ...] = ()
    set: tuple[tuple[str, Setting], ...] = ()


@dataclass(frozen=True)
class RuleSet:
    """Everything that one or more rule files declare, resolved through ``extends``.

    A value: nothing of it is changed once it is made, it can be hashed, and sent to another process.
    """

    name: str
    version: str
    baseline: Span
    params: Params
    materials: Mapping[str, Mapping[str, Quantity]]
    """Material → column → value; the row ``default`` has every column."""
    signals: Mapping[str, SignalDef]
    states: Mapping[str, StateDef]
    phases: Mapping[str, PhaseDef]
    goals: Mapping[str, GoalDef]
    families: Mapping[str, FamilyDef]
    tasks: Mapping[str, TaskDef]
    rules: Mapping[str, Rule]
    """By code. Only the rules of the files that were asked for, not of those they extend."""
    costs: Mapping[str, Cost]
    """By code, as ``rules``."""
    known: dict[object, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Answers about rules and parameter values so far, by the identity of their parts; never pickled."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that its files say, prose and places included."""
        return hashlib.sha256(repr(self).encode()).hexdigest()

    def __hash__(self) -> int:
        return hash(
            (self.name, self.version, frozenset(self.params.items()), frozenset(self.scoped))
        )

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "known": {}}  # identities mean nothing elsewhere

    @property
    def scoped(self) -> dict[str, Scoped]:
        """Rules and costs by code, the rules first."""
        return {**self.rules, **self.costs}

    def with_scoped(self, changed: Scoped) -> RuleSet:
        """The set with another rule, or cost, in the place of the one of its code."""
        if isinstance(changed, Rule):
            return replace(self, rules={**self.rules, changed.code: changed})
        return replace(self, costs={**self.costs, changed.code: changed})
