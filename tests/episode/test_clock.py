"""How many samples a duration takes, against the definition: the time from stamp to stamp."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.episode import Clock, Lasting
from safestage_eval.episode.clock import is_uniform

spacings = st.lists(st.sampled_from([0.01, 0.013, 0.02, 0.1]), min_size=3, max_size=14)
durations = st.sampled_from([0.005, 0.01, 0.025, 0.05, 0.11, 0.3])


def clock(steps: list[float], unseen: list[int] | None = None) -> Clock:
    t = np.concatenate([[0.0], np.cumsum(steps)])
    hidden = None
    if unseen is not None:
        hidden = np.isin(np.arange(len(t)), unseen)
    found = Clock(t, float(np.median(steps)), hidden)
    found.uniform = False
    return found


@given(spacings, durations)
def test_a_run_lasts_from_its_first_stamp_to_the_one_behind_it(steps, seconds) -> None:
    one = clock(steps)
    window, total, bounds = one.window(Lasting(seconds)), len(one.t), one.bounds
    for i in range(total):
        long = [k for k in range(i + 1, total + 1) if bounds[k] - bounds[i] >= seconds - 1e-9]
        assert window.stop(i) == (long[0] if long else total + 1)
    for k in range(1, total + 1):
        overlaps = [i for i in range(total) if bounds[i + 1] > bounds[k] - seconds + 1e-9]
        assert max(window.first(k), 0) == min(overlaps)


@given(spacings, st.integers(1, 4))
def test_frames_are_counted_and_not_timed(steps, frames) -> None:
    one = clock(steps)
    window, total = one.window(Lasting(None, frames)), len(one.t)
    assert [window.stop(i) for i in range(total)] == [
        i + frames if i + frames <= total else total + 1 for i in range(total)
    ]


@pytest.mark.parametrize("rate", [5.0, 30.0, 60.0, 120.0, 240.0])
@pytest.mark.parametrize("lasting", [Lasting(0.025, 2, brief=True), Lasting(0.5), Lasting(None, 3)])
def test_stamps_at_an_even_rate_say_what_counting_says(rate: float, lasting: Lasting) -> None:
    t = np.arange(200) / rate
    counted, stamped = Clock(t, 1 / rate), Clock(t, 1 / rate)
    assert counted.uniform
    stamped.uniform = False
    for one, other in ((counted.window(lasting), stamped.window(lasting)),
                       (counted.gap(lasting), stamped.gap(lasting))):  # fmt: skip
        for i in range(len(t)):
            assert other.stop(i) == min(one.stop(i), len(t) + 1)
    for k in range(len(t) + 1):
        first = counted.window(lasting).first(k)
        assert max(stamped.window(lasting).first(k), 0) == max(first, 0)


def test_nobody_knows_for_how_many_samples_a_hole_stands() -> None:
    one = clock([0.01, 0.01, 0.5, 0.01, 0.01], unseen=[2])
    assert [one.window(Lasting(None, 3)).stop(i) for i in range(4)] == [3, 3, 3, 6]
    assert [one.gap(Lasting(None, 1)).stop(i) for i in range(4)] == [2, 3, 3, 5]


def test_a_clock_is_uniform_within_five_percent() -> None:
    t = np.arange(50) / 100
    assert is_uniform(t)
    for share, uniform in ((0.01, True), (0.04, True), (0.2, False)):
        off = t.copy()
        off[20] += share * 0.01
        assert is_uniform(off) is uniform


def test_samples_behind_a_hole_are_not_those_of_the_start() -> None:
    one = clock([0.01, 0.01, 0.01, 1.0, 0.01, 0.01], unseen=[4])  # put in behind the fourth
    assert [one.together(0, n) for n in range(1, 7)] == [1, 2, 3, 4, 4, 4]
    assert one.together(5, 3) == 3
    lost = clock([0.01] * 8, unseen=[1, 2])  # no hole: two samples tell nothing
    assert lost.together(0, 5) == 5
    assert clock([0.01] * 3).together(0, 5) == 5


@pytest.mark.parametrize(
    ("rate", "many"), [(120, 5), (20, 5), (15, 4), (10, 3), (5, 2), (2.4, 1), (0.5, 1)]
)
def test_first_samples_come_as_soon_as_at_20_hz(rate: float, many: int) -> None:
    t = np.arange(10) / rate
    assert Clock(t, 1 / rate).soon(5) == many
    assert Clock(t[:many], 1 / rate).soon(5) == 5  # more may come
