"""Where a rule's verdict turns as one parameter rises."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.monotone import direction
from safestage_eval.verdicts.verdict import Verdict, VerdictName

from .again import Again, Value
from .values import amount

_WORSE: dict[VerdictName, int] = {
    "not_applicable": 0,
    "pass": 0,
    "inconclusive": 1,
    "violation": 2,
}


def verdicts_under(
    again: Again, rule: ast.Scoped, param: str, values: Sequence[Value]
) -> tuple[VerdictName, ...]:
    """The verdict of a rule under each of the rising values.

    Where raising the parameter can only make it worse (or only better), the one place at which it
    changes is searched for: first where the margin says, then by halving.
    """
    base, now = again.base(rule)

    def at(index: int) -> VerdictName:
        return again.under(base, rule, {param: values[index]}).verdict

    way = direction(again.rules, rule, param)
    if way is None:
        return tuple(map(at, range(len(values))))
    if way == 0:
        return (now.verdict,) * len(values)
    count = len(values)
    order = range(count) if way > 0 else range(count - 1, -1, -1)
    guess = _guess(now, values)
    if guess is not None and way < 0:
        guess = count - guess
    names: dict[int, VerdictName] = {}

    def named(place: int) -> VerdictName:
        if place not in names:
            names[place] = at(order[place])
        return names[place]

    violated = _first(lambda place: _WORSE[named(place)] == 2, count, guess)
    unsure = _first(lambda place: _WORSE[named(place)] >= 1, violated, violated)
    calm: VerdictName = named(0) if unsure else "pass"
    found: list[VerdictName] = [calm] * unsure
    found.extend(["inconclusive"] * (violated - unsure))
    found.extend(["violation"] * (count - violated))
    return tuple(found if way > 0 else reversed(found))


def _first(true: Callable[[int], bool], count: int, guess: int | None) -> int:
    """The first of ``count`` places at which something becomes, and stays, true; ``count`` if never."""
    low, high = 0, count  # true from ``high`` on, false before ``low``
    for place in () if guess is None else (guess, guess - 1):
        if low <= place < high:
            low, high = (low, place) if true(place) else (place + 1, high)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if true(middle) else (middle + 1, high)
    return low


def _guess(verdict: Verdict, values: Sequence[Value]) -> int | None:
    """The first value beyond the decisive measurement; None if that is of another kind."""
    value = values[0]
    dimension = value.dimension if isinstance(value, ast.Quantity) else "time"
    if verdict.value is None or verdict.dimension != dimension:
        return None
    return bisect.bisect_left([amount(v) for v in values], abs(verdict.value))
