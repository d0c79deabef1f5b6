"""Margins against the robustness of signal temporal logic, as RTAMT computes it.

RTAMT (Nickovic & Yamaguchi, "RTAMT: Online Robustness Monitors from STL", 2020) clips a bounded
window at the end of the trace, and has no "inconclusive". So traces are padded there with values
that no stretch can last into, and windows that reach beyond the end are left out.
"""

import math
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from sampled import tries
from toy import ALONE, HEAD, Facts, judge_toy

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of the parser generator it uses
    rtamt = pytest.importorskip("rtamt", reason="not installed for this Python")

SIGNALS = tries(150, 1_500)
"""For each of the formulas below; hardly one in twelve is left out (``response``)."""
LIMIT = 2
FAR = 1e9
AT_LEAST = f'{{ "height(a)" = ">= {LIMIT} m" }}'

CASES: dict[str, tuple[str, str, int]] = {
    "require": (f"require = {AT_LEAST}", f"always(x >= {LIMIT})", 0),
    "forbid": (f"forbid = {AT_LEAST}", f"not(eventually(x >= {LIMIT}))", 0),
    "reach": (f"reach = {AT_LEAST}", f"eventually(x >= {LIMIT})", 0),
    "forbid for": (
        f'forbid = {AT_LEAST}\nfor = "3 frames"',
        f"not(eventually(always[0:2](x >= {LIMIT})))",
        2,
    ),
    "reach for": (
        f'reach = {AT_LEAST}\nfor = "3 frames"',
        f"eventually(always[0:2](x >= {LIMIT}))",
        2,
    ),
    "until": (
        f'require = {AT_LEAST}\nuntil = "q(b)"',
        f"(always(x >= {LIMIT})) or ((x >= {LIMIT}) until (q >= 0))",
        0,
    ),
    "response": (
        f'during = "3 frames after q(b)"\nreach = {AT_LEAST}',
        f"always((rise(q >= 0)) implies (eventually[0:2](x >= {LIMIT})))",
        0,
    ),
    "while": (
        f'during = "q(b)"\nrequire = {AT_LEAST}',
        f"always((q >= 0) implies (x >= {LIMIT}))",
        0,
    ),
}
"""Name → our rule, the formula, and by how many frames the signal is padded."""


def robustness(formula: str) -> Callable[[list[float], list[float]], float]:
    """RTAMT's robustness of a formula at the first sample."""
    spec = rtamt.StlDiscreteTimeSpecification()
    spec.declare_var("x", "float")
    spec.declare_var("q", "float")
    spec.spec = f"out = {formula} and (q <= {FAR * 10})"
    spec.parse()

    def of(x: list[float], q: list[float]) -> float:
        found = spec.evaluate({"time": list(range(len(x))), "x": x, "q": q})
        return float(found[0][1])

    return of


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_margins_are_robustness(name: str) -> None:
    rule, formula, pad = CASES[name]
    head = HEAD if "q(b)" in rule else ALONE
    oracle = robustness(formula)
    ties = compared = 0
    for number in range(SIGNALS):
        rng = np.random.default_rng([5, number])
        frames = int(rng.integers(3, 13))
        x = (rng.integers(-6, 7, frames) / 2).tolist()
        q = np.where(rng.random(frames) < 0.3, FAR, -FAR)
        q[0] = -FAR  # rise() sees no edge at the first sample
        found = judge_toy(Facts({"height(a)": x, "height(b)": q}), head + rule)
        if name == "response" and (q[-2:] > 0).any():
            continue  # a window that the trace's end cuts off
        expected = oracle([*x, *[-FAR] * pad], [*q, *[-FAR] * pad])
        compared += 1
        if expected == 0:  # robustness 0 is neither true nor false; our language says which
            ties += 1
        else:
            assert (found.verdict == "pass") == (expected > 0), (x, q.tolist(), found.verdict)
        if found.margin_normalised is not None and math.isfinite(found.margin_normalised):
            assert found.margin_normalised * LIMIT == pytest.approx(expected, abs=1e-9), (x, q)
    assert compared >= (SIGNALS if name != "response" else SIGNALS / 3)
    assert ties < compared / 2
