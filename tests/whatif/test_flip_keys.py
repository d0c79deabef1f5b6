"""Keys say at which value of a parameter a truth may first be another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Clock
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import crisp
from safestage_eval.states.persistence import persistent
from safestage_eval.verdicts.values import lasting
from safestage_eval.whatif.flip_keys import compared, key_of, latched, mirrored, value_of
from safestage_eval.whatif.flip_lasting import Counts, closed_keys, first_true, lasting_keys

NUMBERS = st.floats(0, 1e6)
SIGNED = st.floats(-1e6, 1e6)
HOLDS = {">=": np.greater_equal, ">": np.greater, "<=": np.less_equal, "<": np.less}


@given(NUMBERS, NUMBERS)
def test_mirroring_turns_the_order_round_and_loses_no_digit(a, b):
    assert mirrored(mirrored(np.array([a])))[0] == a
    assert (a < b) == (key_of(a, "down") > key_of(b, "down"))
    assert value_of(-key_of(a, "down"), "down") == a
    assert value_of(-np.inf, "down") is None


@settings(max_examples=300)
@given(SIGNED, st.one_of(NUMBERS, st.none()), st.sampled_from(list(HOLDS)), st.booleans())
@pytest.mark.parametrize("way", ["up", "down"])
def test_a_comparison_changes_at_its_key_and_not_before(way, measured, value, op, negative):
    value = abs(measured) if value is None else value  # the limit itself among them

    def holds(parameter):
        return bool(HOLDS[op](measured, -parameter if negative else parameter))

    key = float(compared(np.array([measured]), op, value, way, negative)[0])
    assert (key >= 0) == holds(value)
    first = value_of(key, way)
    if first is None:
        assert holds(1e300 if way == "up" else 0.0) == holds(value)
        return
    assert first > value if way == "up" else 0 <= first < value
    assert holds(first) != holds(value)
    before = float(np.nextafter(first, 0.0 if way == "up" else np.inf))
    assert holds(before) == holds(value)


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), max_size=70))
def test_what_holds_on_is_followed_frame_by_frame(pairs):
    on, keep = (np.array([pair[i] or 1 for pair in pairs], float) for i in (0, 1))
    held, expected = -np.inf, []
    for a, b in zip(on, keep, strict=True):
        held = min(max(a, held), b)
        expected.append(held)
    assert latched(on, keep).tolist() == expected


@settings(deadline=None)
@given(
    st.lists(st.booleans(), min_size=1, max_size=30),
    st.floats(0, 0.4),
    st.floats(0, 0.4),
    st.sampled_from(["for", "gap"]),
)
@pytest.mark.parametrize("way", ["up", "down"])
def test_what_lasts_changes_with_the_duration_as_its_keys_say(way, truths, value, other, which):
    """Under every other duration on the way there, the state is what it was; ``other`` samples them."""
    clock = Clock(np.arange(len(truths)) / 60.0, 1 / 60)
    counts = Counts(clock, ast.Duration(0.1))
    frames = crisp(np.array(truths))

    def held(seconds):
        if which == "for":
            window, gap = clock.window(lasting(ast.Duration(seconds))), 0
        else:
            window, gap = 1, clock.gap(lasting(ast.Duration(seconds), 0))
        return persistent(frames, window, gap).lower >= 0

    if which == "for":
        keys = lasting_keys(frames.lower, counts, value, way, open_end=False)
    else:
        keys = closed_keys(frames.lower, counts, value, way)
    assert ((keys >= 0) == held(value)).all()
    for i, key in enumerate(keys):
        first = value_of(float(key), way)
        if first is not None:
            assert held(first)[i] != held(value)[i]
        on_the_way = value <= other if way == "up" else other <= value
        reached = first is not None and (first <= other if way == "up" else other <= first)
        if on_the_way and not reached:
            assert held(other)[i] == held(value)[i]


@given(st.floats(0, 1e5))
def test_the_first_true_number_is_found_to_the_last_digit(number):
    assert first_true(lambda x: x >= number) == number
    assert first_true(lambda x: x >= number, number / 2, number * 2) == number
