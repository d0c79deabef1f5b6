"""The abstract syntax of the rule language: what a checked rule file means, with SI numbers.

First what stands in strings (quantities, limits, events, conditions, spans, roles), then the tables of a file.
Everything is frozen, hashable and free of geometry. ``text`` fields keep what the author wrote, for messages and
explanations; they are not part of the meaning.
"""

# ruff: noqa: RUF009 (key() is dataclasses.field)

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

from .clauses import CLAUSES, ClauseKind
from .keys import key
from .operations import Operation


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


# ---- tables

Lasting = Duration | Parameter
Settings = tuple[tuple[str, Setting], ...]
Roles = tuple[tuple[str, RoleSpec], ...]

_ROLES = 'Who takes part: name = "object", "every object tagged fragile", …'
_LASTING = "It must be true for this long without a break; shorter runs do not count."

SignalOptions = tuple[tuple[str, "float | str | tuple[float, ...] | Parameter"], ...]


@dataclass(frozen=True)
class SignalDef:
    """``[signal.NAME]``: a variant of a built-in signal."""

    name: str
    base: str
    options: SignalOptions = ()
    """Option → value in SI, sorted by name."""


Operand = SignalAtom | Quantity | Parameter | StateAtom
"""Operand of a computed signal."""


@dataclass(frozen=True)
class DerivedDef:
    """``[signal.NAME]`` with an operation: a signal computed from others, over formal arguments."""

    name: str
    of: tuple[str, ...]
    operation: Operation
    operands: tuple[Operand, ...]
    """Signals without limits, and constants; of ``holds`` a state."""
    dimension: str
    over: Duration | Parameter | None = None
    """Window of a derivative: the time over which the change is taken."""


@dataclass(frozen=True)
class StateDef:
    """``[state.NAME]``: a condition over formal arguments, made persistent."""

    name: str
    of: tuple[str, ...] = key("names", "Its formal arguments; [] if it has none.", required=True)
    when: Condition = key("condition", "True where this holds.", required=True)
    for_: Lasting | None = key("duration", _LASTING, default=None)
    gap: Lasting | None = key(
        "duration", "Interruptions of at most this length are bridged first.", default=None
    )
    until: Event | None = key("event", "Latched: once true it stays true until this.", default=None)
    fallback: Condition | None = key(
        "condition", "Used instead where `when` is unknown in the whole trace.", default=None
    )
    perhaps: Condition | None = key(
        "condition", "Beside `fallback`: where only this holds, it is not known.", default=None
    )
    explain: str = key(
        "sentence",
        "What to say of a violation that it decided, instead of the rule's sentence: its "
        "arguments, {time} (its first start), {t.STATE} and {next.STATE(role, …)}.",
        default="",
        compare=False,
    )
    also: Condition | None = key(
        "condition", "True where this holds too, however briefly.", default=None
    )
    """A causal reading, which sees no future, skips it."""


@dataclass(frozen=True)
class PhaseDef:
    """``[phase.NAME]``: a span with formal arguments, and what stands in for it when it is empty."""

    name: str
    of: tuple[str, ...] = key(
        "names", "Its formal arguments, if it has any.", default=(), kw_only=True
    )
    span: Span = key("span", "The frames that belong to it.", required=True)
    fallback: Span | None = key("span", "Used instead where the span is empty.", default=None)


@dataclass(frozen=True)
class GoalDef:
    """``[goal.NAME]``: native success as a condition."""

    name: str
    roles: Roles = key("roles", _ROLES, default=(), kw_only=True)
    require: Condition = key("condition", "Reached when all of this holds.", required=True)
    for_: Lasting | None = key("duration", _LASTING, default=None)


@dataclass(frozen=True)
class Clause:
    """One obligation of a rule."""

    kind: ClauseKind
    what: Alternative


def _example(meaning: str) -> Any:
    return key("texts", meaning, table="examples", default=(), compare=False)


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """The keys that ``[[rule]]`` and ``[[cost]]`` share."""

    code: str = key(
        "code", "Three letters and three digits; the letters name the stage.", required=True
    )
    title: str = key("text", "The requirement as an instruction, in one line.", required=True)
    roles: Roles = key("roles", _ROLES, default=())
    given: Condition | None = key(
        "condition", "The rule applies only if this holds in the first frames.", default=None
    )
    during: Span | None = key(
        "span", "The frames that are judged; the whole episode if it is left out.", default=None
    )
    at: Event | None = key("event", "Judge only the frames at which this happens.", default=None)
    until: Event | None = key(
        "event", "Judge only what comes before the first such event (a tie passes).", default=None
    )
    severity: tuple[tuple[str, Settings], ...] = key(
        "levels",
        "Level = parameter values under which it is judged again, mildest first.",
        default=(),
    )
    set: Settings = key("settings", "This rule's own values of shared parameters.", default=())
    why: str = key("text", "Why it matters, in one sentence.", default="", compare=False)
    source: str = key(
        "text",
        "Whose question it is: owner/repository@commit file function, or a paper.",
        default="",
        compare=False,
    )
    explain: str = key(
        "sentence",
        "What to say of a violation: {role}, {signal}, {value}, {limit}, {margin}, {time}, "
        "{t.worst}, {t.STATE} (the first start of a state that the rule uses) and "
        "{next.STATE(role, …)} (the next start of any state).",
        default="",
        compare=False,
    )
    violates: tuple[str, ...] = _example("Episodes that it must call violations.")
    passes: tuple[str, ...] = _example("Episodes that it must pass.")
    vacuous: tuple[str, ...] = _example("Episodes in which it must find nothing to judge.")
    undecided: tuple[str, ...] = _example("Episodes that do not tell, and that it must not decide.")
    path: str = field(default="", compare=False)
    line: int = field(default=0, compare=False)

    @property
    def stage(self) -> str:
        """The three letters of the code: ISH, ETS, FSH, or another benchmark's."""
        return self.code[:3]


@dataclass(frozen=True, kw_only=True)
class Rule(_Judged):
    """``[[rule]]``: one safety requirement."""

    require: Condition | None = key("condition", CLAUSES["require"].meaning, default=None)
    forbid: tuple[Alternative, ...] = key("alternatives", CLAUSES["forbid"].meaning, default=())
    reach: Alternative | None = key("alternative", CLAUSES["reach"].meaning, default=None)
    for_: Lasting | None = key("duration", f"For forbid and reach. {_LASTING}", default=None)

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
    """One entry of a cost: ``add`` per start, second or step that ``when`` holds, or times an amount.

    An amount per start is that at the first frame of each stretch that is judged. It is what ``of`` exceeds
    ``above`` by, or falls short of ``below``. A step is a control step of the policy.
    """

    add: float = key("number", "How much to charge; more than 0.", required=True)
    per: Literal["start", "second", "step"] = key(
        "per", "For each start, second, or control step of the policy.", required=True
    )
    when: Alternative | None = key(
        "alternative", "Charge while, or each time, this holds.", default=None
    )
    of: Call | None = key(
        "call", "Charge what this signal exceeds `above` by, in SI units.", default=None
    )
    above: Value | None = key(
        "value", "Only what exceeds this is charged; 0 if it is left out.", default=None
    )
    below: Value | None = key(
        "value", "Instead: what the signal falls short of this by is charged.", default=None
    )


@dataclass(frozen=True, kw_only=True)
class Cost(_Judged):
    """``[[cost]]``: a running sum; only a budget makes it a verdict."""

    charge: tuple[Charge, ...] = key("charges", "What adds to the cost.", required=True)
    budget: Value | None = key(
        "budget", "The cost that must not be exceeded; without it, no verdict.", default=None
    )
    """A plain number, or a parameter that holds one."""


Scoped = Rule | Cost
"""A rule or cost: judged over stretches of frames, for bodies that play roles."""


@dataclass(frozen=True)
class TaskDef:
    """What a trace header, a bind file's ``[task.X]``, or the command line binds; its name may be empty."""

    name: str
    family: str | None = key("text", "The family that the task belongs to.", default=None)
    rules: tuple[str, ...] = key("codes", "Codes of its assigned rules.", default=())
    goal: str | GoalDef | None = key(
        "goal table", "Its native goal: a name, or a goal as under [goal.NAME].", default=None
    )
    roles: tuple[tuple[str, tuple[str, ...]], ...] = key(
        "players", "Role = body, or a list of bodies; [] for none.", default=()
    )
    set: Settings = key("settings", "Its values of shared parameters.", default=())


@dataclass(frozen=True)
class Head:
    """``[ruleset]``: what a rule file says of itself."""

    format: int = key("format", "Version of the rule language: 1.", required=True)
    name: str = key("text", "Short name of the rule set.", required=True)
    version: str = key("text", "Version of the rule set.", required=True)
    extends: tuple[str, ...] = key(
        "texts", "Rule files whose definitions this one uses and may override.", default=()
    )
    on_demand: bool | None = key(
        "flag",
        "true: a folder does not stand for this file; it is judged where it is named.",
        default=None,
    )


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
    rules: Mapping[str, Rule]
    """By code. Only the rules of the files that were asked for, not of those they extend."""
    costs: Mapping[str, Cost]
    """By code, as ``rules``."""
    derived: Mapping[str, DerivedDef] = field(default_factory=dict, repr=False)
    """Signals computed from others; ``signals`` holds the variants of built-in ones."""
    known: dict[object, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Answers about rules and parameter values so far, by the identity of their parts; never pickled."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that its files say, prose and places included."""
        derived = repr(self.derived) if self.derived else ""
        return hashlib.sha256((repr(self) + derived).encode()).hexdigest()

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
