"""The operations of derived signals: their operands and their dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from safestage_eval.units import dimension_of_powers, powers_of, same_kind

Operation = Literal[
    "difference", "product", "magnitude", "abs", "derivative", "integral", "sparc", "holds",
]  # fmt: skip


@dataclass(frozen=True)
class OperationSpec:
    """One operation.

    Attributes:
        meaning: one sentence, shown by editors.
        least, most: how many operands it takes.
        result: of which dimension it is: the ``same`` as its operands, which share one; that of
            their ``product``; that of its operand ``per second`` or ``times seconds``; a plain
            ``number``; a ``ratio``.
        pointwise: its value at a frame depends on its operands at that frame alone.
        over: it may be given a time over which it is taken.
        of_state: its operand is a state or relation.
        costly: it takes long, and is found only at the frames that matter.
    """

    meaning: str
    least: int
    most: int
    result: Literal["same", "product", "per second", "times seconds", "number", "ratio"]
    pointwise: bool = True
    over: bool = False
    of_state: bool = False
    costly: bool = False


MANY = 8

OPERATIONS: dict[Operation, OperationSpec] = {
    "difference": OperationSpec("The first less the second.", 2, 2, "same"),
    "product": OperationSpec("All of them multiplied.", 2, MANY, "product"),
    "magnitude": OperationSpec("Root of the sum of their squares.", 2, MANY, "same"),
    "abs": OperationSpec("Its size, without its sign.", 1, 1, "same"),
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
            "the difference of two temperatures",
        )
    if result in ("number", "ratio"):
        return result
    powers: dict[str, int] = {}
    for dimension in given:
        for unit, power in powers_of(dimension).items():
            powers[unit] = powers.get(unit, 0) + power
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
