"""Formulas of RTAMT, translated into the rule language, have the robustness that RTAMT gives them."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of the parser generator it uses
    rtamt = pytest.importorskip("rtamt", reason="not installed for this Python")

sys.path.append(str(Path(__file__).parents[2] / "benchmarks" / "peers"))
from rtamt_formulas import CannotSayError, Formula, values

FORMULAS = [
    "x + 2 * y - abs(x)",
    "abs(x - y) <= 2",
    "x * y > 1",
    "(x >= 1) and not (y < 0)",
    "(x >= 1) implies (y >= x)",
    "prev (x >= 0)",
    "s_prev (x >= 0)",
    "rise(x >= 0) or fall(y >= 0)",
    "once[1,3] (x >= y)",
    "historically[0,2] (x + y >= -3)",
    "(x >= -1) since[0,4] (y >= 2)",
    "(x >= -1) since (once[1,2] (y >= 2))",
    "historically ((x >= 3) implies (once[0,2] (y >= 1)))",
    "always (x >= y)",
    "always[1,3] (x >= y)",
    "eventually (abs(x) >= 3)",
    "eventually[2,4] (x * y >= 1)",
    "(x >= -2) until (y >= 1)",
    "(x >= -2) until[1,3] (y >= 1)",
    "next (x >= y)",
    "s_next (x >= y)",
]


@pytest.mark.parametrize("formula", FORMULAS)
def test_the_robustness_is_rtamts(formula: str) -> None:
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in ("x", "y", "out"):
        spec.declare_var(name, "float")
    spec.spec = f"out = {formula}"
    spec.parse()
    said = Formula(spec.spec, {})
    rng = np.random.default_rng(len(formula))
    for _ in range(4):
        count = int(rng.integers(6, 14))
        samples = {name: (rng.integers(-9, 10, count) / 2).tolist() for name in ("x", "y")}
        found = spec.evaluate({"time": list(range(count)), **samples})
        theirs = [value for _, value in found]
        assert values(said, samples) == pytest.approx(theirs, abs=1e-9), samples


@pytest.mark.parametrize("formula", ["x / y", "sqrt(x)", "5", "once (eventually (x >= 0))"])
def test_what_cannot_be_said_is_refused(formula: str) -> None:
    with pytest.raises(CannotSayError):
        Formula(f"out = {formula}", {})
