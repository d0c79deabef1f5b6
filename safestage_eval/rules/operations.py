"""The operations of derived signals: their operands and their dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from safestage_eval.units import an, dimension_of_powers, powers_of, same_kind

Operation = Literal[
    "sum", "difference", "product", "quotient", "magnitude", "min", "max", "abs", "root",
    "derivative", "integral", "sparc", "holds",
]  # fmt: skip


@dataclass(frozen=True)
class OperationSpec:
    """One operation.

    Attributes:
        meaning: one sentence, shown by editors.
        least, most: how many operands it takes.
        result: of which dimension it is: the ``same`` as its operands, which share one; that of
            their ``product`` or ``quotient``; that of its operand ``per second`` or ``times
            seconds``; that of its ``root``; a plain ``number``; a ``ratio``.
        pointwise: its value at a frame depends on its operands at that frame alone.
        over: it may be given a time over which it is taken.
        of_state: its operand is a state or relation.
        costly: it takes long, and is found only at the frames that matter.
    """

    meaning: str
    least: int
    most: int
    result: Literal[
        "same", "product", "quotient", "per second", "times seconds", "root", "number", "ratio"
    ]
    pointwise: bool = True
    over: bool = False
    of_state: bool = False
    costly: bool = False


MANY = 8

OPERATIONS: dict[Operation, OperationSpec] = {
    "sum": OperationSpec("All of them added up.", 2, MANY, "same"),
    "difference": OperationSpec("The first less the second.", 2, 2, "same"),
    "product": OperationSpec("All of them multiplied.", 2, MANY, "product"),
    "quotient": OperationSpec(
        "The first divided by the second; not known where that may be 0.", 2, 2, "quotient"
    ),
    "magnitude": OperationSpec("Root of the sum of their squares.", 2, MANY, "same"),
    "min": OperationSpec("The least of them.", 2, MANY, "same"),
    "max": OperationSpec("The greatest of them.", 2, MANY, "same"),
    "abs": OperationSpec("Its size, without its sign.", 1, 1, "same"),
    "root": OperationSpec("Its square root; not known where it may be negative.", 1, 1, "root"),
    "derivative": OperationSpec(
        "Its change since the sample before, or with `over` within that time around it, per second.",
        1, 1, "per second", pointwise=False, over=True,
    ),
    "integral": OperationSpec(
        "What it adds up to since the start, each value times the time since the sample before.",
        1, 1, "times seconds", pointwise=False,
    ),
    "holds": OperationSpec("1 where a state or relation holds, 0 where it does not.", 1, 1, "ratio", of_state=True),
    "sparc": OperationSpec(
        "Spectral arc length of all its values up to there, negative: the lower, the less smooth.",
        1, 1, "number", pointwise=False, costly=True,
    ),
}  # fmt: skip


class DimensionError(ValueError):
    """Operands that an operation cannot take.

    Attributes:
        what: what is wrong.
        allowed: what would do.
    """

    def __init__(self, what: str, allowed: str) -> None:
        super().__init__(what)
        self.what, self.allowed = what, allowed


def dimension_of_result(operation: Operation, given: Sequence[str]) -> str:
    """The dimension of a derived signal from those of its operands. Raises DimensionError."""
    result = OPERATIONS[operation].result
    if result == "same":
        first = given[0]
        for other in given[1:]:
            if not same_kind(first, other):
                raise DimensionError(
                    f"{operation} of a {first} and a {other}", "operands of one dimension"
                )
        return "number" if "number" in given else first
    if "temperature" in given and result != "per second":
        raise DimensionError(
            f"{operation} of a temperature, whose zero is arbitrary",
            "the difference of two temperatures in sum, difference, min or max",
        )
    if result in ("number", "ratio"):
        return result
    powers: dict[str, int] = {}
    for place, dimension in enumerate(given):
        sign = -1 if result == "quotient" and place else 1
        for unit, power in powers_of(dimension).items():
            powers[unit] = powers.get(unit, 0) + sign * power
    if result == "root":
        if any(power % 2 for power in powers.values()):
            raise DimensionError(
                f"root of {an(given[0])}, which is no square", "a square: an area, a ratio, …"
            )
        powers = {unit: power // 2 for unit, power in powers.items()}
    seconds = {"per second": -1, "times seconds": 1}.get(result, 0)
    powers["s"] = powers.get("s", 0) + seconds
    if set(given) <= {"number", "ratio"} and not seconds:
        return "number" if "number" in given else "ratio"
    known = dimension_of_powers(powers)
    if known is None:
        unit = " ".join(f"{u}^{p}" if p != 1 else u for u, p in sorted(powers.items()) if p)
        raise DimensionError(
            f"{operation} of {' and '.join(given)} is in {unit}, for which there is no unit",
            "results in a unit of the language (docs/rules.md)",
        )
    return known
