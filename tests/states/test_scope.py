"""Scopes: the arithmetic of half-open stretches of frames."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.states.scope import (
    Scope,
    after,
    before,
    first_part,
    from_to,
    last_part,
    of_truth,
    until,
    within,
)

flags = st.lists(st.booleans(), min_size=1, max_size=20)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=24))
def test_from_to_is_the_state_machine(pairs: list[tuple[bool, bool]]) -> None:
    on, off = (np.array(x) for x in zip(*pairs, strict=True))
    active, expected = False, []
    for start, stop in pairs:
        active = (start or active) and not stop
        expected.append(active)
    covered = np.zeros(len(pairs), bool)
    for first, last, _ in from_to(on, off, truncated=False):
        assert not covered[first:last].any()
        covered[first:last] = True
    assert covered.tolist() == expected


def test_empty_scope_where_both_happen_at_once() -> None:
    now = np.array([False, True, False])
    assert from_to(now, now, truncated=False) == [Scope(1, 1)]


def test_only_what_reaches_the_end_of_a_truncated_trace_is_cut() -> None:
    truth = np.array([True, False, True])
    assert of_truth(truth, truncated=True) == [Scope(0, 1), Scope(2, 3, True)]
    assert of_truth(truth, truncated=False) == [Scope(0, 1), Scope(2, 3)]


def test_parts() -> None:
    assert first_part([Scope(2, 10)], 3) == [Scope(2, 5)]
    assert first_part([Scope(2, 4, True)], 3) == [Scope(2, 4, True)]
    assert last_part([Scope(2, 10)], 3) == [Scope(7, 10)]
    assert last_part([Scope(2, 10, True)], 3) == [Scope(10, 10, True)]
    assert after([8], 5, 10) == [Scope(8, 10, True)]
    assert after([2], 5, 10) == [Scope(2, 7)]
    assert before([2, 8], 5) == [Scope(0, 2), Scope(3, 8)]


def test_within_and_until() -> None:
    truth = np.array([0, 1, 1, 0, 1, 1], bool)
    assert within([Scope(0, 6)], truth) == [Scope(1, 3), Scope(4, 6)]
    assert within([Scope(0, 6, True)], truth) == [Scope(1, 3), Scope(4, 6, True)]
    assert within([Scope(0, 4, True)], truth) == [Scope(1, 3), Scope(4, 4, True)]
    assert until([Scope(0, 6)], truth) == [Scope(0, 1)]
    assert until([Scope(0, 6)], np.zeros(6, bool)) == [Scope(0, 6)]


@given(flags, flags)
def test_within_covers_the_intersection(inside: list[bool], truth: list[bool]) -> None:
    size = min(len(inside), len(truth))
    a, b = np.array(inside[:size]), np.array(truth[:size])
    covered = np.zeros(size, bool)
    for first, last, _ in within(of_truth(a, truncated=False), b):
        covered[first:last] = True
    assert covered.tolist() == (a & b).tolist()
