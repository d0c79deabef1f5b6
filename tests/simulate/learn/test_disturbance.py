"""Notes on disturbed control steps: written and read back."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from simulate.learn.disturbance import disturbance_note, disturbed

SPANS = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 9)), max_size=5)


@given(SPANS)
def test_what_is_written_is_read(pairs: list[tuple[int, int]]) -> None:
    spans = [(first, first + more) for first, more in pairs]
    expected = np.zeros(40, bool)
    for step in range(40):
        expected[step] = any(first <= step <= last for first, last in spans)
    assert np.array_equal(disturbed(("task abc", *disturbance_note(spans)), 40), expected)


def test_other_notes_say_nothing() -> None:
    assert not disturbed(("task 12-20", "arm model: x"), 30).any()
    assert disturbance_note([]) == ()
