"""Every verdict has a sentence that says what was seen: value, limit, bodies and time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from toy import ALONE, Facts, judge_toy, series

TEN = np.linspace(0.5, 0.1, 5)


def explained(rule: str, bodies: tuple[str, ...] = ("cup",), **heights: Any) -> str:
    """The sentence for the rule on these bodies, of which ``height`` is given at 10 Hz."""
    facts = Facts(
        {f"height({name})": np.asarray(values, float) for name, values in heights.items()},
        rate=10.0,
    )
    return judge_toy(facts, ALONE + rule, {"a": bodies}).explanation


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ('require = { "height(a)" = ">= 4 cm" }', "at least 4.0 cm is required"),
        ('require = { "height(a)" = "> 4 cm" }', "more than 4.0 cm is required"),
        ('require = { "height(a)" = "<= 60 cm" }', "at most 60.0 cm is allowed"),
        ('require = { "height(a)" = "< 60 cm" }', "less than 60.0 cm is allowed"),
        ('forbid = { "height(a)" = "< 4 cm" }', "at least 4.0 cm is required"),
        ('forbid = { "height(a)" = "<= 4 cm" }', "more than 4.0 cm is required"),
        ('forbid = { "height(a)" = "> 60 cm" }', "at most 60.0 cm is allowed"),
        ('forbid = { "height(a)" = ">= 60 cm" }', "less than 60.0 cm is allowed"),
    ],
)
def test_a_pass_says_on_which_side_of_the_limit_the_value_must_lie(limit: str, said: str) -> None:
    low = "least" in said or "more" in said
    value, time = ("10.0 cm", "0.40 s") if low else ("50.0 cm", "0.00 s")
    found = explained(limit, cup=TEN)
    assert found == f"Closest to the limit: height(cup) was {value} at {time}; {said}."


def test_a_violation_without_a_sentence_of_its_own_has_the_limit_too() -> None:
    found = explained('require = { "height(a)" = ">= 20 cm" }', cup=TEN)
    assert found == "height(cup) was 10.0 cm at 0.40 s; at least 20.0 cm is required."


def test_bodies_that_came_as_close_are_counted() -> None:
    rule = 'require = { "height(a)" = ">= 4 cm" }'
    found = explained(rule, ("cup", "jug", "mug"), cup=TEN, jug=TEN, mug=TEN + 1)
    assert found.startswith("Closest to the limit, 1 other tied: height(cup) was 10.0 cm at 0.40 s")


def test_of_what_has_no_size_the_sentence_says_that_it_came() -> None:
    rule = """forbid = "start of p(a)"
    explain = "{a} fell: {signal} was {value} at {t.worst}; the limit is {limit}." """
    assert explained(rule, cup=series("00011")) == "cup fell: start of p(cup) came at 0.30 s."


def test_what_no_measurement_decides_is_named_with_its_bodies_and_times() -> None:
    rule = 'forbid = "start of p(a)"'
    found = explained(rule, cup=series("00000"))
    assert found == "No start of p(cup), 0.00 s to 0.50 s."
    names = ("cup", "jug", "mug", "pot", "pan", "tin")
    found = explained(rule, names, **dict.fromkeys(names, series("00000")))
    assert found == ("No start of p(a) (a: cup, jug, mug, pot and 2 more), 0.00 s to 0.50 s.")


def test_a_scope_that_never_comes_or_has_no_frames_is_named() -> None:
    required = 'require = { "height(a)" = ">= 20 cm" }\n'
    never = explained(required + 'during = "from success to end"', cup=TEN)
    assert never == "Not reached: from success to end never came about."


def test_what_was_presumed_and_is_not_so_is_named() -> None:
    found = explained('given = { "height(a)" = "< 0 m" }\nrequire = { "p(a)" = true }', cup=TEN)
    assert found == "Not applicable: the first frames do not show height(cup) less than 0 m."
