"""Scopes: the arithmetic of half-open stretches of frames."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.states.moment import Moment, Truth, ends, starts
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
from safestage_eval.states.scope import at as one_frame


def known(truth) -> Truth:
    return Truth(np.asarray(truth, bool), np.asarray(truth, bool))


def at(*frames: int) -> list[Moment]:
    return [Moment(frame, frame) for frame in frames]


flags = st.lists(st.booleans(), min_size=1, max_size=20)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=24))
def test_from_to_is_the_state_machine(pairs: list[tuple[bool, bool]]) -> None:
    on, off = (np.array(x) for x in zip(*pairs, strict=True))
    active, expected = False, []
    for start, stop in pairs:
        active = (start or active) and not stop
        expected.append(active)
    covered = np.zeros(len(pairs), bool)
    for first, last, _, _ in from_to(known(on), known(off), truncated=False):
        assert not covered[first:last].any()
        covered[first:last] = True
    assert covered.tolist() == expected


def test_empty_scope_where_both_happen_at_once() -> None:
    now = np.array([False, True, False])
    assert from_to(known(now), known(now), truncated=False) == [Scope(1, 1)]


def test_only_what_reaches_the_end_of_a_truncated_trace_is_cut() -> None:
    truth = np.array([True, False, True])
    assert of_truth(known(truth), truncated=True) == [Scope(0, 1), Scope(2, 3, True)]
    assert of_truth(known(truth), truncated=False) == [Scope(0, 1), Scope(2, 3)]


def test_parts() -> None:
    assert first_part([Scope(2, 10)], 3) == [Scope(2, 5)]
    assert first_part([Scope(2, 4, True)], 3) == [Scope(2, 4, True)]
    assert last_part([Scope(2, 10)], 3) == [Scope(7, 10)]
    assert last_part([Scope(2, 10, True)], 3) == [Scope(10, 10, True)]
    assert after(at(8), 5, 10) == [Scope(8, 10, True)]
    assert after(at(2), 5, 10) == [Scope(2, 7)]
    assert before(at(2, 8), 5) == [Scope(0, 2), Scope(3, 8)]


def test_within_and_until() -> None:
    truth = np.array([0, 1, 1, 0, 1, 1], bool)
    assert within([Scope(0, 6)], known(truth)) == [Scope(1, 3), Scope(4, 6)]
    assert within([Scope(0, 6, True)], known(truth)) == [Scope(1, 3), Scope(4, 6, True)]
    assert within([Scope(0, 4, True)], known(truth)) == [Scope(1, 3), Scope(4, 4, True)]
    assert until([Scope(0, 6)], known(truth)) == [Scope(0, 1)]
    assert until([Scope(0, 6)], known(np.zeros(6, bool))) == [Scope(0, 6)]


@given(flags, flags)
def test_within_covers_the_intersection(inside: list[bool], truth: list[bool]) -> None:
    size = min(len(inside), len(truth))
    a, b = np.array(inside[:size]), np.array(truth[:size])
    covered = np.zeros(size, bool)
    for first, last, _, _ in within(of_truth(known(a), truncated=False), known(b)):
        covered[first:last] = True
    assert covered.tolist() == (a & b).tolist()


# ---- what is not known: bounds that hold whatever it turns out to be

TRUTHS = st.lists(st.sampled_from("01?"), min_size=1, max_size=9).map("".join)


def partly(text: str) -> Truth:
    return Truth(np.array([c == "1" for c in text]), np.array([c != "0" for c in text]))


def completions(text: str):
    """Every way in which the unknown frames may turn out."""
    for bits in itertools.product("01", repeat=text.count("?")):
        fill = iter(bits)
        yield known([(next(fill) if c == "?" else c) == "1" for c in text])


def covered(scopes: list[Scope], frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Frames that are certainly, and possibly, in one of the scopes."""
    sure, possible = np.zeros(frames, bool), np.zeros(frames, bool)
    for scope in scopes:
        sure[scope.first : scope.stop] |= scope.certain
        possible[scope.first : scope.stop] = True
    return sure, possible


def check_bounds(build, *texts: str) -> None:
    """Each completion lies between what is certain and what is possible; where all is known, on both."""
    frames = len(texts[0])
    sure, possible = covered(build(*map(partly, texts)), frames)
    assert (sure <= possible).all()
    for truths in itertools.product(*map(completions, texts)):
        exact = covered(build(*truths), frames)[1]
        assert (sure <= exact).all(), (texts, truths)
        assert (exact <= possible).all(), (texts, truths)


@given(TRUTHS, st.integers(1, 4), st.booleans())
def test_bounds_of_parts_and_windows(text: str, count: int, truncated: bool) -> None:
    frames = len(text)

    def runs_of(truth: Truth) -> list[Scope]:
        return of_truth(truth, truncated=truncated)

    check_bounds(runs_of, text)
    check_bounds(lambda x: first_part(runs_of(x), count), text)
    if not truncated:
        check_bounds(lambda x: last_part(runs_of(x), count), text)
    for moments in (starts, ends):
        check_bounds(lambda x, m=moments: after(m(x), count, frames), text)
        check_bounds(lambda x, m=moments: before(m(x), count), text)
        check_bounds(lambda x, m=moments: one_frame(m(x)), text)


@settings(deadline=None)
@given(st.integers(1, 6), st.data())
def test_bounds_of_two_truths(frames: int, data: st.DataObject) -> None:
    texts = [
        "".join(data.draw(st.lists(st.sampled_from("01?"), min_size=frames, max_size=frames)))
        for _ in range(2)
    ]
    check_bounds(lambda on, off: from_to(on, off, truncated=False), *texts)
    check_bounds(lambda a, b: within(of_truth(a, truncated=False), b), *texts)
    check_bounds(lambda a, b: until(of_truth(a, truncated=False), b), *texts)
    check_bounds(lambda a, b: first_part(until(from_to(a, b, truncated=False), b), 2), *texts)


@pytest.mark.parametrize(
    ("text", "begin", "end"),
    [
        ("0110", [Moment(1, 1)], [Moment(3, 3)]),
        ("0??1", [Moment(1, 3)], [Moment(2, 2, False)]),
        ("1??0", [Moment(0, 0), Moment(2, 2, False)], [Moment(1, 3)]),
        ("1?1", [Moment(0, 0), Moment(2, 2, False)], [Moment(1, 1, False)]),
        ("0?0", [Moment(1, 1, False)], [Moment(2, 2, False)]),
        ("11", [Moment(0, 0)], []),
        ("1?", [Moment(0, 0)], [Moment(1, 1, False)]),
        ("??", [Moment(0, 1, False)], [Moment(1, 1, False)]),
    ],
)
def test_moments(text: str, begin: list[Moment], end: list[Moment]) -> None:
    assert starts(partly(text)) == begin
    assert ends(partly(text)) == end
