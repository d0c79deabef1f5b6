"""Laws of every rule and signal: tightening, margins, appending, rates, names, masks."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import tries
from toy import ALONE, HEAD, Facts, judge_toy, ruleset

from safestage_eval.evidence.intervals import Interval
from safestage_eval.rules.syntax import Quantity
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.obligations import judge_instances
from safestage_eval.verdicts.players import combinations
from safestage_eval.verdicts.verdict import Verdict

REAL = st.lists(st.integers(-8, 8).map(lambda x: x / 2), min_size=1, max_size=14)
LIMITS = st.integers(1, 6).map(lambda x: x / 2)
KINDS = st.sampled_from(["require", "forbid", "reach"])
SPANS = st.sampled_from(
    ["episode", "q(b)", "last 3 frames of episode", "first 2 frames of q(b)", "from start to q(b)"]
)

laws = settings(deadline=None, max_examples=tries(30, 100))


def rule(kind: str, lasting: int = 1, span: str = "episode", op: str = ">=", more: str = "") -> str:
    """A rule about a's height, and b's where the span asks for it; its limit is a parameter."""
    head = (HEAD if "(b)" in span + more else ALONE) + f'during = "{span}"\n'
    head = head.replace("[[rule]]", '[param]\nlimit = "1 m"\n[[rule]]')
    text = f'{head}{kind} = {{ "height(a)" = "{op} limit" }}\n{more}'
    return text if kind == "require" else f'{text}for = "{lasting} frames"\n'


def judged(
    a: list[float], b: list[float], text: str, limit: float = 1.0, rate: float = 1.0
) -> Verdict:
    size = min(len(a), len(b))
    facts = Facts({"height(a)": a[:size], "height(b)": b[:size]}, rate=rate)
    return judge_toy(facts, text, limit=Quantity(limit, "length"))


@laws
@given(REAL, REAL, KINDS, LIMITS, st.integers(0, 4), st.integers(1, 3), SPANS)
def test_tightening_a_limit_never_removes_a_violation(a, b, kind, limit, more, lasting, span):
    """A floor that is required rises, a floor that is forbidden sinks, one to be reached rises."""
    tighter = limit + more / 2 if kind != "forbid" else max(limit - more / 2, 0.25)
    before = judged(a, b, rule(kind, lasting, span), limit)
    after = judged(a, b, rule(kind, lasting, span), tighter)
    assert (before.verdict, after.verdict) != ("violation", "pass")


@laws
@given(REAL, REAL, KINDS, LIMITS, st.integers(1, 3), SPANS, st.sampled_from([">=", "<=", ">", "<"]))
def test_the_sign_of_the_margin_is_the_verdict(a, b, kind, limit, lasting, span, op):
    found = judged(a, b, rule(kind, lasting, span, op), limit)
    assert found.verdict in ("pass", "violation")
    if found.margin_normalised is not None:
        assert (found.margin_normalised < 0) == (found.verdict == "violation")
    if found.margin is not None and found.margin != 0:
        assert (found.margin < 0) == (found.verdict == "violation")


@laws
@given(REAL, REAL, KINDS, LIMITS, st.integers(1, 3), st.data())
def test_frames_after_the_end_of_a_scope_change_nothing(a, more, kind, limit, lasting, data):
    b = [-1.0] * (len(a) - 1) + [1.0]  # the scope ends before the last of these frames
    text = rule(kind, lasting, "from start to q(b)")
    tail = data.draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=len(more), max_size=len(more)))
    short, long = judged(a, b, text, limit), judged(a + more, b + tail, text, limit)
    assert short == long


RUNS = st.lists(st.integers(6, 15), min_size=1, max_size=6)
"""Lengths of stretches at the fine rate: three coarse frames at least."""


def alternating(runs: list[int], high: float = 1.0) -> list[float]:
    return [(high if i % 2 else -high) for i, size in enumerate(runs) for _ in range(size)]


@laws
@given(RUNS, st.sampled_from(["0.1 s", "0.2 s", "0.3 s", "2 frames @ 20 Hz"]), st.integers(0, 1))
def test_half_the_rate_keeps_what_lasts_longer_than_two_frames(runs, lasting, phase):
    fine = alternating(runs)
    text = f'{ALONE}forbid = "s(a)"\n[state.s]\nof = ["x"]\nfor = "{lasting}"\n'
    text += 'gap = "0.1 s"\nwhen = { "height(x)" = ">= 0 m" }\n'
    at_20 = judge_toy(Facts({"height(a)": fine}, rate=20.0), text)
    at_10 = judge_toy(Facts({"height(a)": fine[phase::2]}, rate=10.0), text)
    assert at_10.verdict == at_20.verdict
    if at_20.time is not None:
        assert at_10.time + phase / 20 == pytest.approx(at_20.time, abs=0.1 + 1e-9)
        assert len(at_10.intervals) == len(at_20.intervals)
        assert at_10.exposure_time == pytest.approx(
            at_20.exposure_time, abs=0.1 * len(at_20.intervals) + 1e-9
        )


@laws
@given(REAL, REAL, KINDS, LIMITS, st.integers(1, 3), SPANS)
def test_names_of_bodies_mean_nothing(a, b, kind, limit, lasting, span):
    text = rule(kind, lasting, span)
    size = min(len(a), len(b))
    facts = Facts({"height(zebra)": a[:size], "height(ant)": b[:size]})
    players = {"a": ("zebra",), "b": ("ant",)} if "(b)" in text else {"a": ("zebra",)}
    found, plain = (
        judge_toy(facts, text, players, limit=Quantity(limit, "length")),
        judged(a, b, text, limit),
    )
    assert (found.verdict, found.margin, found.intervals) == (
        plain.verdict, plain.margin, plain.intervals,
    )  # fmt: skip
    assert [{"zebra": "a", "ant": "b"}[x] for x in found.bodies] == list(plain.bodies)


# ---- what is hidden


class Blurred(Facts):
    """Interval of which each value is only known to lie in an interval."""

    def __init__(self, series: dict[str, list[float]], widths: dict[str, list[float]]) -> None:
        super().__init__(series)
        self._widths = widths

    def signal(self, name, bodies, *_):
        found = super().signal(name, bodies)
        width = np.asarray(self._widths[f"{name}({', '.join(bodies)})"])
        return Interval(found.lower - width, found.upper + width, found.dimension)


def bounds(facts: Facts, text: str, limit: float) -> tuple[float, float]:
    """Bounds of the worst margin over all instances."""
    rules = ruleset(text)
    (checked,) = rules.rules.values()
    evaluator = Evaluator(facts, rules, {"limit": Quantity(limit, "length")}, None)
    players = {name: (name,) for name, _ in checked.roles}
    evaluator.players = players
    found = [
        instance
        for env in combinations(checked, players)
        for instance in judge_instances(evaluator, checked, env) or ()
    ]
    return (
        min((i.lower for i in found), default=math.inf),
        min((i.upper for i in found), default=math.inf),
    )


@settings(deadline=None, max_examples=tries(60, 200))
@given(REAL, REAL, KINDS, LIMITS, st.integers(1, 3), SPANS, st.booleans(), st.data())
def test_the_interval_holds_the_true_margin(a, b, kind, limit, lasting, span, until, data):
    """Whatever part of the data is hidden or blurred: unknown never becomes a wrong answer."""
    size = min(len(a), len(b))
    text = rule(kind, lasting, span, more='until = "q(b)"\n' if until else "")
    true = {"height(a)": a[:size], "height(b)": b[:size]}
    widths = {
        name: [data.draw(st.sampled_from([0.0, 0.0, 0.5, 2.0, math.inf])) for _ in values]
        for name, values in true.items()
    }
    exact = bounds(Facts(true), text, limit)
    assert exact[0] == exact[1]
    lower, upper = bounds(Blurred(true, widths), text, limit)
    assert lower <= exact[0] <= upper
    value = Quantity(limit, "length")
    found = judge_toy(Blurred(true, widths), text, limit=value)
    full = judge_toy(Facts(true), text, limit=value)
    assert found.verdict in ("inconclusive", full.verdict)
