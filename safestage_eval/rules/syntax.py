"""The abstract syntax of the rule language: what a checked rule file means, with SI numbers.

The tables of a file; what stands in their strings (quantities, limits, events, spans, roles) is in
``string_syntax``, and is handed on. Everything is frozen, hashable and free of geometry. ``text`` fields
keep what the author wrote, for messages and explanations; they are not part of the meaning.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

from .clauses import CLAUSES, ClauseKind
from .operations import Operation
from .string_syntax import (
    Alternative,
    AnyOf,
    Around,
    Atom,
    Call,
    Column,
    Condition,
    CountAtom,
    Duration,
    Event,
    FromTo,
    Limit,
    PairAtom,
    Parameter,
    Params,
    Part,
    PastAtom,
    PhaseSpan,
    Quantity,
    RoleSpec,
    Setting,
    SignalAtom,
    Span,
    StateAtom,
    StateSpan,
    Value,
    While,
    Whole,
    amount,
)

__all__ = [
    "Alternative",
    "AnyOf",
    "Around",
    "Atom",
    "Call",
    "Column",
    "Condition",
    "CountAtom",
    "Duration",
    "Event",
    "FromTo",
    "Limit",
    "PairAtom",
    "Parameter",
    "Params",
    "Part",
    "PastAtom",
    "PhaseSpan",
    "Quantity",
    "RoleSpec",
    "Setting",
    "SignalAtom",
    "Span",
    "StateAtom",
    "StateSpan",
    "Value",
    "While",
    "Whole",
    "amount",
]  # handed on


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
    """One entry of a cost: ``add`` per start, second or step that ``when`` holds, or times an amount.

    An amount per start is that at the first frame of each stretch that is judged. It is what ``of`` exceeds ``above`` by, or falls short of ``below``; with ``whole`` all of
    it, where it exceeds. A step is a control step of the policy.
    """

    add: float
    per: Literal["start", "second", "step"]
    when: Alternative | None = None
    of: Call | None = None
    above: Value | None = None
    below: Value | None = None
    whole: bool | None = None


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
