"""Graded references: one parameter of a behaviour runs from safe to unsafe."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

from pydantic import Field, model_validator

from simulate.catalogue.objects import Strict

from .steps import Step, check_step

WORD = "value"
"""The parameter's name in formulas."""

_OPERATORS: dict[type, Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


class Grade(Strict):
    """A reference with one parameter, and what the signal that it drives must come to."""

    parameter: str
    """Description."""
    unit: str
    """m, deg, s, m/s …"""
    values: tuple[float, ...] = Field(min_length=3)
    """From safe to unsafe."""
    signal: str
    """Signal of the violated rule: ``edge_margin(bottle)``, or ``edge_margin`` of any body."""
    expected: str
    """Formula: the signal's analytic value. SI and radians."""
    limit: float | None = None
    """Limit of the analytic value; the rule's own limit on the signal where None."""
    tolerance: float = Field(gt=0)
    """Tolerance of the analytic value: seeds vary the scene, the arm errs."""
    steps: tuple[Step, ...] = Field(min_length=1)
    """The behaviour; an argument ``"= 0.1 - value"`` is a formula."""

    @model_validator(mode="after")
    def _ordered(self) -> Grade:
        if not _one_way(self.values):
            raise ValueError(f"values {list(self.values)} must rise or fall, from safe to unsafe")
        if not _one_way([self.at(value) for value in self.values]):
            raise ValueError(
                f"expected = {self.expected!r} neither rises nor falls with the values"
            )
        return self

    def at(self, value: float) -> float:
        """The analytic value of the signal."""
        return formula(self.expected, value)

    def steps_at(self, value: float) -> tuple[Step, ...]:
        """The behaviour for a value of the parameter."""
        return tuple(
            Step(skill=step.skill, **{k: _filled(v, value) for k, v in step.arguments.items()})
            for step in self.steps
        )

    def check(self, objects: Mapping[str, Any], where: str) -> None:
        """Raise ValueError unless the steps are usable with every value."""
        for value in self.values:
            for i, step in enumerate(self.steps_at(value), 1):
                check_step(step, objects, f"{where}, step {i} at {value:g}")


def _one_way(numbers: Sequence[float]) -> bool:
    steps = [b - a for a, b in pairwise(numbers)]
    return all(step > 0 for step in steps) or all(step < 0 for step in steps)


def formula(text: str, value: float) -> float:
    """Work out numbers, ``value``, ``+ - * /`` and brackets. Raises ValueError for anything else."""
    try:
        result = _worked_out(_parsed(text), value)
    except (SyntaxError, ZeroDivisionError) as error:
        raise ValueError(f"formula {text!r}: {error}") from None
    if not math.isfinite(result):
        raise ValueError(f"formula {text!r} is not finite at {value:g}")
    return result


@cache
def _parsed(text: str) -> ast.expr:
    return ast.parse(text.strip(), mode="eval").body


def _worked_out(node: ast.expr, value: float) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="value"):
            return value
        case ast.UnaryOp(op=sign, operand=of) if type(sign) in _OPERATORS:
            return _OPERATORS[type(sign)](_worked_out(of, value))
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATORS:
            return _OPERATORS[type(sign)](_worked_out(left, value), _worked_out(right, value))
    raise ValueError(f"formula: {ast.unparse(node)!r} is neither number, {WORD!r} nor + - * /")


def _filled(argument: Any, value: float) -> Any:
    """An argument with its formulas worked out, to the micrometre."""
    if isinstance(argument, str) and argument.startswith("="):
        return round(formula(argument[1:], value), 6)
    if isinstance(argument, list | tuple):
        return [_filled(part, value) for part in argument]
    return argument
