"""Where a rule's verdict turns as one parameter rises."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from typing import NamedTuple

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.monotone import direction
from safestage_eval.verdicts.verdict import Verdict, VerdictName, at_risk

from .again import Again, Value
from .swept_values import amount

_WORSE: dict[VerdictName, int] = {
    "not_applicable": 0,
    "pass": 0,
    "inconclusive": 1,
    "violation": 2,
}


class Turned(NamedTuple):
    """What a rule says under each of the rising values.

    Attributes:
        names: its verdicts.
        at_risk: whether each was reached on something.
    """

    names: tuple[VerdictName, ...]
    at_risk: tuple[bool, ...]


def risked(verdict: Verdict) -> bool:
    """It was reached on something."""
    return at_risk(verdict.verdict, verdict.instances, verdict.vacuity)


def verdicts_under(again: Again, rule: ast.Scoped, param: str, values: Sequence[Value]) -> Turned:
    """The verdict of a rule under each of the rising values.

    Where raising the parameter can only make it worse (or only better), the one place at which it
    changes is searched for: first where the margin says, then by halving. Such a parameter moves no
    scope, so that verdicts alike are at risk alike.
    """
    base, now = again.base(rule)

    def at(index: int) -> tuple[VerdictName, bool]:
        found = again.under(base, rule, {param: values[index]})
        return found.verdict, risked(found)

    way = direction(again.rules, rule, param)
    count = len(values)
    if way is None:
        return _turned([at(index) for index in range(count)])
    if way == 0:
        return _turned([(now.verdict, risked(now))] * count)
    order = range(count) if way > 0 else range(count - 1, -1, -1)
    guess = _guess(now, values)
    if guess is not None and way < 0:
        guess = count - guess
    said: dict[int, tuple[VerdictName, bool]] = {}

    def told(place: int) -> tuple[VerdictName, bool]:
        if place not in said:
            said[place] = at(order[place])
        return said[place]

    violated = _first(lambda place: _WORSE[told(place)[0]] == 2, count, guess)
    unsure = _first(lambda place: _WORSE[told(place)[0]] >= 1, violated, violated)
    found: list[tuple[VerdictName, bool]] = []
    for first, stop in ((0, unsure), (unsure, violated), (violated, count)):
        found.extend([told(first)] * (stop - first) if first < stop else [])
    return _turned(found if way > 0 else found[::-1])


def _turned(found: Sequence[tuple[VerdictName, bool]]) -> Turned:
    return Turned(tuple(name for name, _ in found), tuple(risk for _, risk in found))


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
