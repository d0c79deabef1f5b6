"""The values that a sweep visits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from safestage_eval.errors import RuleError, did_you_mean
from safestage_eval.rules import RuleSet, parse_overrides
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.syntax import amount
from safestage_eval.units import DIMENSIONS, unit_of


def like(value: ast.Setting, number: float) -> ast.Setting:
    """A value of the same kind; a duration in plain seconds, or in frames of the trace."""
    if isinstance(value, ast.Quantity):
        return ast.Quantity(number, value.dimension)
    return replace(value, amount=number, least=1, text="")


def chosen(
    rules: RuleSet, param: str, texts: Sequence[str], option: str = "--values"
) -> list[ast.Setting]:
    """Values as written, each checked against the parameter.

    Raises RuleError for an unknown parameter, a value of another dimension, or no value.
    """
    if param not in rules.params:
        raise RuleError(
            f"--param {param}",
            "no loaded rule file declares it.",
            ", ".join(sorted(rules.params)),
            did_you_mean(param, rules.params),
        )
    values = []
    for text in filter(None, map(str.strip, texts)):
        try:
            values.append(parse_overrides(rules, {param: text})[param])
        except RuleError as error:
            raise RuleError(f'{option} "{text}"', error.what, error.allowed, error.fix) from None
    if not values:
        raise RuleError(option, "names no value.", f'values with commas: {option} "1 cm, 2 cm"')
    return values


def between(
    rules: RuleSet, param: str, first: str | None, last: str | None, steps: int
) -> list[ast.Setting]:
    """Evenly spaced values from ``first`` to ``last``, both included.

    Without ends, from nothing to twice the default. Frames are whole, so there may be fewer.

    Raises RuleError for an unknown parameter, ends of another dimension or of two kinds, an empty
    range, or a default of zero without ends.
    """
    given = {
        option: chosen(rules, param, [text], option)[0]
        for option, text in (("--from", first), ("--to", last))
        if text is not None
    }
    if param not in rules.params:
        chosen(rules, param, [""])
    default = rules.params[param]
    low = given.get("--from", _scaled(default, 0.0))
    high = given.get("--to", _scaled(default, 2.0))
    where = f"--from {text_of(low)} --to {text_of(high)}"
    if _in_frames(low) != _in_frames(high):
        raise RuleError(where, "one is in frames, the other in seconds.", "both in the same unit")
    a, b = amount(low), amount(high)
    if not a < b:
        raise RuleError(where, "the range is empty.", "--from less than --to")
    numbers = [a + (b - a) * i / (steps - 1) for i in range(steps)]
    if _in_frames(low):
        numbers = sorted({float(round(n)) for n in numbers})
    return [like(low, number) for number in numbers]


def text_of(value: ast.Setting) -> str:
    """A value in the unit that reports print, with as many digits as it needs."""
    if isinstance(value, ast.Duration):
        return f"{value.amount:.5g} {'frames' if value.frames else 's'}"
    return f"{value.value / factor_of(value):.5g} {unit_of(value.dimension)}".rstrip()


def factor_of(value: ast.Setting) -> float:
    """SI size of the unit that reports print."""
    if isinstance(value, ast.Duration):
        return 1.0
    unit = unit_of(value.dimension)
    return DIMENSIONS[value.dimension][unit] if unit else 1.0


def si_unit(value: ast.Setting) -> str:
    """The unit of ``amount``: SI, ``s`` or ``frames``; empty for a plain number."""
    if isinstance(value, ast.Duration):
        return "frames" if value.frames else "s"
    units = [unit for unit, factor in DIMENSIONS[value.dimension].items() if factor == 1.0]
    return units[0] if units else ""


def told_in(values: Sequence[ast.Setting], unit: str) -> bool:
    """Whether verdicts on ranges in a unit (``si_unit``) tell of all these values.

    Ranges in seconds do not of a duration in frames, nor of "3 frames @ 120 Hz", which asks for several
    samples whatever the rate; and none do of values below 0.
    """
    several = any(isinstance(value, ast.Duration) and value.least > 1 for value in values)
    return not several and all(si_unit(value) == unit and amount(value) >= 0 for value in values)


def unit_name(value: ast.Setting) -> str:
    """The unit that reports print."""
    if isinstance(value, ast.Duration):
        return "frames" if value.frames else "s"
    return unit_of(value.dimension)


def _in_frames(value: ast.Setting) -> bool:
    return isinstance(value, ast.Duration) and value.frames


def _scaled(value: ast.Setting, factor: float) -> ast.Setting:
    return like(value, amount(value) * factor)
