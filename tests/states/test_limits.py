"""Margins of limits from the kernel are those of the plain formula, to the bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.states.band import TINY
from safestage_eval.states.limits import limit_margin, limit_margin_slowly

values = st.floats(width=64) | st.sampled_from([0.0, 0.08, -0.08, np.inf, -np.inf])


@given(
    st.lists(values, max_size=40),
    values.filter(np.isfinite),
    st.floats(1e-6, 1e6),
    st.booleans(),
    st.booleans(),
)
def test_the_same_bits(series, limit, size, up, open_):
    value = np.array([*series, limit])
    with np.errstate(all="ignore"):
        plain = limit_margin_slowly(value, limit, size, up=up, open_=open_)
    found = limit_margin(value, limit, size, up=up, open_=open_)
    assert np.array_equal(found, plain, equal_nan=True)
    assert np.array_equal(np.signbit(found[found == 0]), np.signbit(plain[plain == 0]))


@pytest.mark.parametrize("up", [True, False])
def test_at_the_limit_only_a_comparison_that_allows_it_holds(up):
    value = np.full(3, 0.08)
    assert (limit_margin(value, 0.08, 0.08, up=up, open_=False) == 0).all()
    assert (limit_margin(value, 0.08, 0.08, up=up, open_=True) == -TINY).all()


def test_repeated_and_read_only_values_are_taken_too():
    one = np.broadcast_to(np.array([0.3]), 4)
    assert limit_margin(one, 0.1, 0.1, up=True, open_=False) == pytest.approx([2.0] * 4)
