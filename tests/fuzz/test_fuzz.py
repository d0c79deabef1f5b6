"""Hostile inputs end in a verdict that stands, or in words; benchmarks/fuzz.py tries many more."""

import pytest
from targets import TARGETS, attempt

FEW = {
    "parquet": 30,
    "mcap": 40,
    "robolab": 25,
    "maniskill": 30,
    "lerobot": 40,
    "ros": 30,
    "foxglove": 40,
    "mujoco": 40,
    "rules": 60,
    "bind": 60,
    "map": 60,
    "tables": 60,
}
"""Of each format, by default; in the slow tests the next three times as many."""


@pytest.mark.parametrize("key", FEW)
@pytest.mark.parametrize("many", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_hostile_inputs(tmp_path, key, many):
    target = TARGETS[key](tmp_path)
    few = FEW[key]
    numbers = range(few, 4 * few) if many else range(few)
    outcomes = {number: attempt(target, number) for number in numbers}
    assert not {number: told for number, told in outcomes.items() if told.bad}
    assert sum(told.kind == "problem" for told in outcomes.values()) > few / 10
