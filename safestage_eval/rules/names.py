"""The names that rule files may use: their arguments, dimensions and kinds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from safestage_eval.evidence.declare import Signal
from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION, an

from . import string_parser
from . import syntax as ast
from .operations import OPERATIONS, DimensionError, Operation, dimension_of_result

RESERVED = frozenset(
    [
        "after", "any", "at", "before", "end", "episode", "every", "except", "first", "from",
        "last", "least", "most", "of", "since", "start", "success", "tagged", "to", "until",
        "while",
    ]
)  # fmt: skip
"""Words of the language, which cannot name anything."""


@dataclass
class Names:
    """Everything that may be named, from all files that were read together.

    Values that could not be read stand as None: the name is known, its meaning is not, and no
    second problem is reported for it.

    Attributes:
        params: name → dimension (``time`` for durations).
        columns: material column → dimension.
        states: declared state → formal arguments.
        phases: phase → formal arguments.
        variants: declared signal → what it is, with its options given.
        derived: declared signals that are computed from others, as TOML gives them.
    """

    params: dict[str, str | None] = field(default_factory=dict)
    columns: dict[str, str | None] = field(default_factory=dict)
    states: dict[str, tuple[str, ...] | None] = field(default_factory=dict)
    phases: dict[str, tuple[str, ...] | None] = field(default_factory=dict)
    variants: dict[str, Signal | None] = field(default_factory=dict)
    derived: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def of_rules(cls, rules: ast.RuleSet) -> Names:
        """From a rule set that is already loaded."""
        default = rules.materials.get("default", {})
        return cls(
            params={name: dimension_of(value) for name, value in rules.params.items()},
            columns={name: value.dimension for name, value in default.items()},
            states={name: state.of for name, state in rules.states.items()},
            phases={name: phase.of for name, phase in rules.phases.items()},
            variants={
                **{n: SIGNALS[s.base].variant(dict(s.options)) for n, s in rules.signals.items()},
                **{name: derived_signal(one) for name, one in rules.derived.items()},
            },
            derived={name: {"of": one.of} for name, one in rules.derived.items()},
        )

    def signal(self, name: str) -> Signal | None:
        """The built-in signal behind a name, if it is one or a variant of one."""
        return self.variants[name] if name in self.variants else SIGNALS.get(name)

    def is_state(self, name: str) -> bool:
        """A declared state or a built-in relation."""
        return name in self.states or name in RELATIONS

    def callable(self) -> list[str]:
        """All names that take roles in a condition."""
        return [*SIGNALS, *self.variants, *RELATIONS, *self.states]

    def declare(self, table: Mapping[str, Any]) -> None:
        """Take up the states, phases and signals of a file as TOML gives it, of any shape.

        A later one overrides an earlier one; ``derive`` says what computed ones are.
        """
        for kind, declared in (("state", self.states), ("phase", self.phases)):
            for name, value in table_of(table, kind).items():
                declared[name] = _formals(value)
        for name, value in table_of(table, "signal").items():
            self.derived.pop(name, None)
            self.variants.pop(name, None)
            if isinstance(value, dict) and operation_of(value) is not None:
                self.derived[name] = value
                continue
            base = value.get("base") if isinstance(value, dict) else None
            spec = SIGNALS.get(base) if isinstance(base, str) else None
            self.variants[name] = spec.variant(value) if spec is not None else None

    def derive(self) -> None:
        """Find what all computed signals are."""
        for name in self.derived:
            self._derive(name)

    def operand_dimension(self, value: Any) -> str | None:
        """Dimension of the operands of a derived signal, as TOML gives them; None if unknown."""
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            return None
        try:
            operand = string_parser.operand(value)
        except string_parser.GrammarError:
            return None
        if isinstance(operand, ast.SignalAtom):
            if operand.call.name in self.derived:
                self._derive(operand.call.name)
            spec = self.signal(operand.call.name)
            return None if spec is None else spec.dimension
        return (
            operand.dimension
            if isinstance(operand, ast.Quantity)
            else self.params.get(operand.name)
        )

    def _derive(self, name: str) -> None:
        """Find what a derived signal is, from what it is computed from; what leads back to it is None."""
        if name in self.variants:
            return
        self.variants[name] = None
        table = self.derived[name]
        operation, formals = operation_of(table), _formals(table)
        assert operation is not None
        spec = OPERATIONS[operation]
        given = [
            "ratio" if spec.of_state else self.operand_dimension(one) for one in operands_of(table)
        ]
        if formals is None or None in given or not spec.least <= len(given) <= spec.most:
            return
        try:
            dimension = dimension_of_result(operation, [str(one) for one in given])
        except DimensionError:
            return
        self.variants[name] = _derived(name, formals, dimension)


def operation_of(table: Mapping[str, Any]) -> Operation | None:
    """The operation that a ``[signal.NAME]`` names, None if it is a variant of a built-in signal."""
    return next((name for name in OPERATIONS if name in table), None)


def operands_of(table: Mapping[str, Any]) -> list[Any]:
    """Operands of a computed signal, as in TOML."""
    value = table.get(operation_of(table) or "", [])
    return value if isinstance(value, list) else [value]


def derived_signal(derived: ast.DerivedDef) -> Signal:
    """Declaration of a computed signal, in the form of a built-in one."""
    return _derived(derived.name, derived.of, derived.dimension)


def _derived(name: str, formals: tuple[str, ...], dimension: str) -> Signal:
    def measure(_: Any) -> Any:
        raise TypeError(f"{name}() is computed from other signals")

    return Signal(name, dimension, formals, (), measure, "", groups=True, reads="", since=True)


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
    if name in GROUPS:
        return f"stands for {GROUPS[name]}, without being declared"
    return "is a word of the rule language" if name in RESERVED else ""


def table_of(table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The table of that name in another as TOML gives it; empty where there is none."""
    inner = table.get(name)
    return inner if isinstance(inner, dict) else {}


def _formals(value: Any) -> tuple[str, ...] | None:
    of = value.get("of", []) if isinstance(value, dict) else None
    if isinstance(of, list) and all(isinstance(name, str) for name in of):
        return tuple(of)
    return None
