"""Persistence filters against their definitions, frame by frame."""

from itertools import groupby
from operator import itemgetter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.episode import Clock, Lasting
from safestage_eval.episode.runs import runs
from safestage_eval.states.band import Band, crisp
from safestage_eval.states.persistence import (
    held_from,
    held_until,
    latched,
    persistent,
    without_short_gaps,
    without_short_runs,
)

margins = st.lists(st.integers(-4, 4), min_size=1, max_size=24).map(lambda x: np.array(x, float))
counts = st.integers(1, 6)


def bits(text: str) -> np.ndarray:
    return np.array([1.0 if c == "1" else -1.0 for c in text])


def text(margin: np.ndarray) -> str:
    return "".join("1" if m >= 0 else "0" for m in margin)


def drop_short(truth: str, frames: int) -> str:
    """The definition, on strings: runs of 1 shorter than ``frames`` become 0."""
    out = list(truth)
    for a, b in runs(np.array([c == "1" for c in truth])):
        if b - a < frames:
            out[a:b] = "0" * (b - a)
    return "".join(out)


def close_gaps(truth: str, frames: int) -> str:
    """The definition, on strings: runs of 0 of at most ``frames`` between two 1 become 1."""
    out = list(truth)
    for a, b in runs(np.array([c == "0" for c in truth])):
        if b - a <= frames and a > 0 and b < len(truth):
            out[a:b] = "1" * (b - a)
    return "".join(out)


@given(st.lists(st.booleans(), max_size=24))
def test_runs_are_the_stretches_of_true_frames(truth: list[bool]) -> None:
    frames = [[i for i, _ in part] for on, part in groupby(enumerate(truth), itemgetter(1)) if on]
    expected = [(part[0], part[-1] + 1) for part in frames]
    assert [tuple(run) for run in runs(np.array(truth, np.bool_)).tolist()] == expected


@pytest.mark.parametrize(
    ("given_", "lasting", "gap", "expected"),
    [
        ("011010", 3, 1, "011110"),
        ("000011", 3, 1, "000000"),
        ("000110", 3, 1, "000000"),
        ("111000", 3, 0, "111000"),
        ("000111", 3, 0, "000111"),
        ("101010", 1, 1, "111110"),
    ],
)
def test_truth_table(given_: str, lasting: int, gap: int, expected: str) -> None:
    band = persistent(Band(bits(given_), bits(given_)), lasting, gap)
    assert text(band.lower) == expected


@given(margins, counts)
def test_windows_are_minima(margin: np.ndarray, n: int) -> None:
    size = len(margin)
    ahead = [min(margin[t : t + n]) if t + n <= size else -np.inf for t in range(size)]
    behind = [min(margin[t - n + 1 : t + 1]) if t + 1 >= n else -np.inf for t in range(size)]
    assert held_from(margin, n).tolist() == ahead
    assert held_until(margin, n).tolist() == behind


@given(margins, counts, st.integers(0, 5), st.integers(-4, 4))
def test_filters_commute_with_every_threshold(
    margin: np.ndarray, n: int, gap: int, threshold: int
) -> None:
    shifted = margin - threshold
    assert text(without_short_runs(shifted, n)) == drop_short(text(shifted), n)
    assert text(without_short_gaps(shifted, gap)) == close_gaps(text(shifted), gap)


@given(margins, counts, st.integers(0, 4), st.integers(1, 24))
def test_causal_form_depends_on_no_later_frame(
    margin: np.ndarray, n: int, gap: int, cut: int
) -> None:
    whole = persistent(Band(margin, margin), n, gap, causal=True).lower
    part = persistent(Band(margin[:cut], margin[:cut]), n, gap, causal=True).lower
    assert whole[:cut].tolist() == part.tolist()


@given(margins, counts)
def test_causal_run_counts_from_its_nth_frame(margin: np.ndarray, n: int) -> None:
    now = persistent(Band(margin, margin), n, 0, causal=True).true
    later = persistent(Band(margin, margin), n, 0).true
    for a, b in runs(later):
        assert not now[a : a + n - 1].any()
        assert now[a + n - 1 : b].all()


@given(margins, st.lists(st.booleans(), min_size=24, max_size=24))
def test_latch_is_the_state_machine(margin: np.ndarray, resets: list[bool]) -> None:
    reset = np.array(resets[: len(margin)])
    found = latched(Band(margin, margin), reset).true
    on = False
    for t, m in enumerate(margin):
        on = not reset[t] and (on or bool(m >= 0))
        assert found[t] == on


def test_unknown_frames_stay_unknown_until_decided() -> None:
    truth, known = np.array([True, False, True]), np.array([True, False, True])
    band = crisp(truth, known)
    assert band.unknown.tolist() == [False, True, False]
    # three frames in a row: the unknown one decides, so nothing is certain
    lasting = persistent(band, 3, 0)
    assert lasting.unknown.tolist() == [True, True, True]
    # one frame in a row suffices: the known ones stand
    assert persistent(band, 1, 0).true.tolist() == [True, False, True]


stamps = st.lists(st.sampled_from([0.01, 0.02, 0.1]), min_size=1, max_size=16)


def on_stamps(steps: list[float]) -> Clock:
    clock = Clock(np.concatenate([[0.0], np.cumsum(steps)]), 0.01)
    clock.uniform = False
    return clock


@given(st.data(), stamps, st.sampled_from([0.01, 0.025, 0.1, 0.15]))
def test_on_time_stamps_short_runs_vanish_and_long_ones_stay(data, steps, seconds) -> None:
    clock = on_stamps(steps)
    bounds, total = clock.bounds, len(clock.t)
    truth = data.draw(st.text("01", min_size=total, max_size=total))
    expected = list(truth)
    for a, b in runs(np.array([c == "1" for c in truth])):
        if bounds[b] - bounds[a] < seconds - 1e-9:
            expected[a:b] = "0" * (b - a)
    found = without_short_runs(bits(truth), clock.window(Lasting(seconds)))
    assert text(found) == "".join(expected)


@given(st.data(), stamps, st.sampled_from([0.01, 0.025, 0.1, 0.15]))
def test_on_time_stamps_short_gaps_are_closed_and_long_ones_stay(data, steps, seconds) -> None:
    """The sample in which the time is over still belongs to the gap, as on an even clock."""
    clock = on_stamps(steps)
    t, total = clock.t, len(clock.t)
    truth = data.draw(st.text("01", min_size=total, max_size=total))
    expected = list(truth)
    for a, b in runs(np.array([c == "0" for c in truth])):
        if t[b - 1] - t[a] < seconds - 1e-9 and a > 0 and b < total:
            expected[a:b] = "1" * (b - a)
    found = without_short_gaps(bits(truth), clock.gap(Lasting(seconds)))
    assert text(found) == "".join(expected)


@given(st.data(), stamps, st.integers(1, 4), st.integers(0, 3))
def test_windows_stated_frame_by_frame_filter_as_numbers_of_frames_do(
    data, steps, frames, gap
) -> None:
    clock, total = on_stamps(steps), len(steps) + 1
    margin = np.array(
        data.draw(st.lists(st.integers(-4, 4), min_size=total, max_size=total)), float
    )
    lasting, open_gap = clock.window(Lasting(None, frames)), clock.gap(Lasting(None, gap))
    for causal in (False, True):
        for open_end in (False, True):
            band = Band(margin, margin)
            one = persistent(band, frames, gap, causal=causal, open_end=open_end)
            other = persistent(band, lasting, open_gap, causal=causal, open_end=open_end)
            assert other.lower.tolist() == one.lower.tolist()
            assert other.upper.tolist() == one.upper.tolist()


def test_fewer_samples_than_surely_last_may_have_lasted() -> None:
    brief = Lasting(0.025, 2, brief=True)
    for rate, unknown in ((120, []), (60, [1]), (10, [1])):
        window = Clock(np.arange(20) / rate, 1 / rate).window(brief)
        truths = [bits(text) for text in ("00100", "01100", "01110")]
        sure = [(without_short_runs(m, window) >= 0).any() for m in truths]
        perhaps = [(without_short_runs(m, window.loose) >= 0).any() for m in truths]
        assert [n for n in (1, 2, 3) if perhaps[n - 1] and not sure[n - 1]] == unknown
