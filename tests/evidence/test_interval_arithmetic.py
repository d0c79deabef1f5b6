"""Intervals hold every value that may be, their ends are reached, and what is not known stays so."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.evidence.interval_arithmetic import (
    change_per_second,
    change_since,
    change_within,
    combined,
    summed_over_time,
)
from safestage_eval.evidence.intervals import Interval, exact

NUMBER = st.integers(-8, 8).map(lambda x: x / 2)
INTERVAL = st.tuples(NUMBER, NUMBER).map(lambda x: (min(x), max(x)))
ON_NUMBERS = {
    "difference": lambda x, y: x - y,
    "product": lambda *x: math.prod(x),
    "magnitude": lambda *x: math.sqrt(math.fsum(v * v for v in x)),
    "abs": abs,
}
TAKES = {"difference": 2, "abs": 1}


def series(intervals: list[tuple[float, float]]) -> Interval:
    low, high = np.array(intervals, float).reshape(-1, 2).T
    return Interval(low.copy(), high.copy(), "number")


@settings(deadline=None, max_examples=300)
@given(st.sampled_from(sorted(ON_NUMBERS)), st.lists(INTERVAL, min_size=3, max_size=3), st.data())
def test_an_operation_is_its_own_on_every_choice(operation, intervals, data):
    """All values of a fine grid lie between the ends, and the ends are among them."""
    given_ = intervals[: TAKES.get(operation, data.draw(st.integers(2, 3)))]
    low, high = combined(operation, [series([one]) for one in given_])
    grids = [sorted({*np.linspace(a, b, 5), *([0.0] if a <= 0 <= b else [])}) for a, b in given_]
    found = [ON_NUMBERS[operation](*choice) for choice in itertools.product(*grids)]
    assert low[0] == pytest.approx(min(found), abs=1e-12)
    assert high[0] == pytest.approx(max(found), abs=1e-12)


@settings(deadline=None, max_examples=200)
@given(st.sampled_from(sorted(ON_NUMBERS)), st.lists(NUMBER, min_size=3, max_size=3), st.data())
def test_what_is_not_known_never_narrows(operation, values, data):
    """An operand of which less is known makes the interval no narrower, and never NaN."""
    given_ = values[: TAKES.get(operation, 3)]
    low, high = combined(operation, [exact([one], "number") for one in given_])
    assert low is high
    which = data.draw(st.integers(0, len(given_) - 1))
    ends = data.draw(
        st.sampled_from([(-np.inf, np.inf), (given_[which], np.inf), (-np.inf, given_[which])])
    )
    open_ = [exact([one], "number") for one in given_]
    open_[which] = series([ends])
    wide = combined(operation, open_)
    assert wide[0][0] <= low[0] <= wide[1][0]
    assert not np.isnan(wide).any()


def test_a_derivative_beside_what_was_not_seen_is_not_known() -> None:
    t = np.arange(5) / 10
    seen = series([(0, 0), (1, 1), (-np.inf, np.inf), (3, 3), (4, 5)])
    low, high = change_per_second(seen, t)
    assert low == pytest.approx([10, 10, -np.inf, -np.inf, 10])
    assert high == pytest.approx([10, 10, np.inf, np.inf, 20])
    alone = change_per_second(exact([1.0], "length"), t[:1])
    assert (alone[0][0], alone[1][0]) == (-np.inf, np.inf)


def test_an_integral_is_not_known_behind_what_was_not_seen() -> None:
    """A size, which is at least 0, is no less than before."""
    t = np.arange(5) / 10
    intervals = [(1, 1), (1, 1), (-np.inf, np.inf), (1, 1), (1, 1)]
    low, high = summed_over_time(series(intervals), t)
    assert low[:2] == pytest.approx([0, 0.1])
    assert np.isneginf(low[2:]).all()
    assert np.isposinf(high[2:]).all()
    size = Interval(*combined("abs", [series(intervals)]), "number")
    assert summed_over_time(size, t)[0] == pytest.approx([0, 0.1, 0.1, 0.2, 0.3])


def test_a_change_within_a_time_is_not_known_beside_what_was_not_seen() -> None:
    """Nor where samples lie further apart than half the time."""
    t = np.arange(8) / 10
    intervals = [(k, k) for k in range(8)]
    intervals[4] = (-np.inf, np.inf)
    low, high = change_within(series(intervals), t, 0.1, 0.1)
    assert np.isfinite(low).tolist() == [k not in (3, 4, 5) for k in range(8)]
    assert np.isposinf(high[3:6]).all()
    sparse = np.array([0.0, 0.1, 0.2, 0.5, 0.6])
    low, _ = change_within(exact(np.arange(5.0), "length"), sparse, 0.1, 0.1)
    assert np.isfinite(low).tolist() == [True, True, False, False, True]


def test_a_change_since_a_frame() -> None:
    of = series([(1, 1), (2, 3), (4, 4), (5, 5)])
    low, high = change_since(of, np.array([-1, -1, 1, 1]))
    assert low.tolist() == [0, 1, 1, 2]
    assert high.tolist() == [0, 2, 2, 3]
    known = change_since(exact([1.0, 2.0, 4.0], "length"), np.array([0, 1, 1]))
    assert known[0].tolist() == [0, 0, 2]
    assert known[0] is known[1]
