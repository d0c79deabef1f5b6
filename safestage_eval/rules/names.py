"""The names that rule files may use: their arguments, dimensions and kinds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from safestage_eval.evidence.declare import Relation, Signal
from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION, an

from . import syntax as ast

RESERVED = frozenset(
    [
        "after", "any", "at", "before", "end", "episode", "every", "except", "first", "from",
        "last", "least", "most", "of", "since", "start", "success", "tagged", "to", "until",
        "while",
    ]
)  # fmt: skip
"""Words of the language, which cannot name anything."""

Defined = ast.SignalDef | ast.DerivedDef
"""A signal of a rule file: a variant of a built-in one, or one that is computed."""

DEEPEST = 40
"""Definitions that may rest on one another, one by way of the next."""


class Callee(NamedTuple):
    """What takes roles.

    Attributes:
        kind: what it is.
        arities: how many roles it may be given; None: its definition is wrong, and says so.
        spec: the declaration of a signal or relation, of a computed signal too.
        declared: by a rule file.
    """

    kind: Literal["signal", "state", "phase"]
    arities: tuple[int, ...] | None
    spec: Signal | Relation | None = None
    declared: bool = True

    @property
    def signal(self) -> Signal | None:
        """The declaration of a signal."""
        return self.spec if isinstance(self.spec, Signal) else None


def built_in() -> dict[str, Callee]:
    """All signals and relations that no rule file declares."""
    states = {n: Callee("state", one.arities, one, declared=False) for n, one in RELATIONS.items()}
    signals = {n: Callee("signal", one.arities, one, declared=False) for n, one in SIGNALS.items()}
    return {**states, **signals}


@dataclass
class Names:
    """Everything that may be named, from all files that were read together.

    What could not be read stands as None: the name is known, its meaning is not, and no second problem
    is reported for it.

    Attributes:
        params: name → dimension (``time`` for durations).
        columns: material column → dimension.
        called: what takes roles.
        unread: signals of rule files that nobody asked for so far → how they are read.
        signals: those that were read.
    """

    params: dict[str, str | None] = field(default_factory=dict)
    columns: dict[str, str | None] = field(default_factory=dict)
    called: dict[str, Callee] = field(default_factory=built_in)
    unread: dict[str, Callable[[], Defined | None]] = field(default_factory=dict)
    signals: dict[str, Defined | None] = field(default_factory=dict)
    _depth: int = 0

    @classmethod
    def of_rules(cls, rules: ast.RuleSet) -> Names:
        """From a rule set that is already loaded."""
        names = cls(
            {name: dimension_of(value) for name, value in rules.params.items()},
            {name: cell.dimension for name, cell in rules.materials.get("default", {}).items()},
        )
        names.called |= {n: Callee("phase", (len(one.of),)) for n, one in rules.phases.items()}
        names.called |= {n: Callee("state", (len(one.of),)) for n, one in rules.states.items()}
        names.called |= {name: _signal(one) for name, one in rules.signals.items()}
        names.called |= {name: _signal(one) for name, one in rules.derived.items()}
        return names

    def find(self, name: str) -> Callee | None:
        """What a name stands for; a signal of a rule file is read when it is first asked for."""
        if name in self.unread and self._depth < DEEPEST:
            self._depth += 1
            node = self.signals[name] = self.unread.pop(name)()
            self._depth -= 1
            if node is not None and self._free(name, "signal"):
                self.called[name] = _signal(node)
        return self.called.get(name)

    def expect(self, name: str, read: Callable[[], Defined | None]) -> None:
        """Take up a signal that is still to be read; of several of one name the last counts."""
        self.unread[name] = read
        if self._free(name, "signal"):
            self.called[name] = Callee("signal", None)

    def declare(self, kind: Literal["state", "phase"], name: str, table: Any) -> None:
        """Take up a state or phase as TOML gives it, of any shape."""
        of = table.get("of", []) if isinstance(table, dict) else None
        sound = isinstance(of, list) and all(isinstance(role, str) for role in of)
        arities = (len(of),) if isinstance(of, list) and sound else None
        if self._free(name, kind):
            self.called[name] = Callee(kind, arities)

    def _free(self, name: str, kind: str) -> bool:
        """Whether a name stands for nothing else, built-in or of another kind."""
        before = self.called.get(name)
        return before is None or (before.declared and before.kind == kind)

    def of_kind(self, *kinds: str) -> list[str]:
        """The names of signals, states, phases."""
        return [name for name, callee in self.called.items() if callee.kind in kinds]

    def signal(self, name: str) -> Signal | None:
        """The declaration of a signal, if one has this name and its definition is sound."""
        callee = self.find(name)
        return None if callee is None else callee.signal


def _signal(node: Defined) -> Callee:
    if isinstance(node, ast.DerivedDef):
        spec = derived_signal(node)
    else:
        spec = SIGNALS[node.base].variant(dict(node.options))
    return Callee("signal", spec.arities, spec)


def derived_signal(one: ast.DerivedDef) -> Signal:
    """Declaration of a computed signal, in the form of a built-in one."""

    def measure(_: Any) -> Any:
        raise TypeError(f"{one.name}() is computed from other signals")

    return Signal(one.name, one.dimension, one.of, (), measure, "", groups=True, reads="", since=True)  # fmt: skip


def dimension_of(value: ast.Setting) -> str:
    """``length``, ``angle``, …; a duration is a ``time``."""
    return value.dimension if isinstance(value, ast.Quantity) else "time"


def a_dimension(dimension: str) -> str:
    """``"a length: m, cm, mm"``, for messages."""
    if dimension == "number":
        return "a plain number"
    units = ", ".join(DIMENSIONS[dimension])
    if dimension == "time":
        units += ", frames, frames @ r Hz"
    if dimension == "ratio":
        units += " or a plain number"
    return f"{an(dimension)} ({units})"


def unfit(name: str) -> str:
    """Why a role or formal argument cannot have this name; empty if it can."""
    if name in UNIT_DIMENSION:
        return "is a unit"
    return f"stands for {GROUPS[name]}, without being declared" if name in GROUPS else ""


def table_of(table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The table of that name in another as TOML gives it; empty where there is none."""
    inner = table.get(name)
    return inner if isinstance(inner, dict) else {}
