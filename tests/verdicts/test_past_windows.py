"""Past operators against their definition in words, and against RTAMT; what must not change them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode.clock import Clock, Lasting
from safestage_eval.evidence.intervals import Interval
from safestage_eval.verdicts import windows

STEPS = st.lists(st.integers(1, 4), min_size=12, max_size=12)
MARGINS = st.lists(st.integers(-4, 4).map(lambda x: x + 0.5), min_size=1, max_size=12)
BOUNDS = st.tuples(st.integers(0, 8), st.integers(0, 8)).map(lambda b: (min(b), max(b)))

laws = settings(deadline=None, max_examples=200)


def stamps(steps, count, even):
    return np.arange(count) / 10 if even else np.cumsum([0, *steps])[:count] / 10


def at(t, recent, far):
    """``recent`` and ``far`` in tenths of a second; from the start if ``far`` is None."""
    clock = Clock(t, float(np.median(np.diff(t))) if len(t) > 1 else 0.1)
    return windows.looks(
        clock, Lasting(recent / 10, 0), None if far is None else Lasting(far / 10, 0)
    )


def seen(t, k, recent, far):
    """By the definition: samples that stand for some time from far to recent before t[k]."""
    end = [*t[1:], t[-1] + 1]
    begin = -np.inf if far is None else t[k] - far / 10
    return [j for j in range(k + 1) if t[j] <= t[k] - recent / 10 + 1e-9 and end[j] > begin + 1e-9]


def slow_since(held, begun, k, among):
    """At one of them it began, and it held at all behind."""
    return max((min([begun[j], *held[j + 1 : k + 1]]) for j in among), default=-np.inf)


def exact(values):
    margins = np.array(values, float)
    return Interval(margins, margins)


@laws
@given(MARGINS, MARGINS, STEPS, BOUNDS, st.booleans(), st.booleans())
def test_all_of_them_are_what_they_say(a, b, steps, bounds, even, open_):
    n = min(len(a), len(b))
    a, b, t = a[:n], b[:n], stamps(steps, n, even)
    recent, far = bounds[0], None if open_ else bounds[1]
    window = at(t, recent, far)
    among = [seen(t, k, recent, far) for k in range(n)]
    once = [max((a[j] for j in some), default=-np.inf) for some in among]
    always = [min((a[j] for j in some), default=np.inf) for some in among]
    since = [slow_since(a, b, k, some) for k, some in enumerate(among)]
    assert windows.once(exact(a), window).lower.tolist() == once
    assert windows.always(exact(a), window).lower.tolist() == always
    found = windows.since(exact(a), exact(b), window)
    assert found.lower.tolist() == since
    assert found.exact


INTERVAL = st.tuples(st.integers(-3, 3), st.integers(-3, 3)).map(
    lambda x: (min(x) + 0.5, max(x) + 0.5)
)


@laws
@given(st.lists(INTERVAL, min_size=1, max_size=5), st.lists(INTERVAL, min_size=5, max_size=5),
       BOUNDS, st.data())  # fmt: skip
def test_what_is_not_known_is_all_that_may_be(a, b, bounds, data):
    """Every choice of values lies between the ends; of ``alike`` and of each sample alone, no less."""
    n = len(a)
    b, t = b[:n], np.arange(n) / 10
    bands = [Interval(*np.array(x).T.copy()) for x in (a, b)]
    window = at(t, *bounds)
    found = {
        "once": windows.once(bands[0], window),
        "always": windows.always(bands[0], window),
        "since": windows.since(bands[0], bands[1], window),
        "alike": windows.alike(*bands),
    }
    for _ in range(5):
        one, two = (exact([data.draw(st.sampled_from(ends)) for ends in x]) for x in (a, b))
        for name, value in {
            "once": windows.once(one, window),
            "always": windows.always(one, window),
            "since": windows.since(one, two, window),
            "alike": windows.alike(one, two),
        }.items():
            assert (found[name].lower <= value.lower).all(), name
            assert (value.lower <= found[name].upper).all(), name


with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    rtamt = pytest.importorskip("rtamt", reason="not installed for this Python")


@pytest.mark.parametrize("bounds", [(0, 0), (0, 3), (2, 2), (1, 4), (3, 9), None])
@pytest.mark.parametrize("operator", ["once", "historically", "since"])
def test_on_an_even_clock_they_are_rtamts(operator: str, bounds: tuple[int, int] | None) -> None:
    spec = rtamt.StlDiscreteTimeSpecification()
    spec.declare_var("a", "float")
    spec.declare_var("b", "float")
    inside = "" if bounds is None else f"[{bounds[0]}:{bounds[1]}]"
    formula = (
        f"(a >= 0) since{inside} (b >= 0)" if operator == "since" else f"{operator}{inside}(a >= 0)"
    )
    spec.spec = f"out = ({formula}) and (b <= 1000)"
    spec.parse()
    rng = np.random.default_rng(1)
    for _ in range(60):
        n = int(rng.integers(2, 15))
        a, b = rng.normal(size=(2, n))
        found = spec.evaluate({"time": list(range(n)), "a": a.tolist(), "b": b.tolist()})
        looks = at(np.arange(n) / 10, *(bounds or (0, None)))
        ours = {
            "once": lambda a, _, looks: windows.once(a, looks),
            "historically": lambda a, _, looks: windows.always(a, looks),
            "since": windows.since,
        }[operator](exact(a), exact(b), looks)
        theirs = np.array([value for _, value in found])
        capped = np.minimum(ours.lower, 1000 - b)
        assert capped == pytest.approx(theirs, abs=1e-12)
