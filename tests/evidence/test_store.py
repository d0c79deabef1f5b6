"""A store measures each query once, and never what it knows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.evidence.growing_store import GrowingStore
from safestage_eval.evidence.query import Growth, Query
from safestage_eval.evidence.series import Series, exact
from safestage_eval.evidence.store import Store

QUERY = Query("signal", "height", ("cup",))


@pytest.mark.parametrize(
    "changed",
    [
        {"kind": "relation"}, {"name": "lift"}, {"bodies": ("can",)}, {"bodies": ()},
        {"since": "7"}, {"cap": 0.1}, {"deep": True}, {"slack": 1e-5},
        {"options": (("over", 0.1),)}, {"frame": 3}, {"backend": "fcl"}, {"baseline": 6},
    ],
)  # fmt: skip
def test_queries_that_differ_have_digests_that_differ(changed):
    assert QUERY._replace(**changed).digest != QUERY.digest
    assert QUERY._replace(**changed)._replace(**QUERY._asdict()).digest == QUERY.digest


def test_what_is_known_is_not_measured_again():
    store, measured = Store(), []

    def measure(near):
        measured.append(near)
        return exact([1.0, 2.0], "length")

    first = store.series(QUERY, measure)
    assert store.series(QUERY, measure) is first
    assert store.series(QUERY._replace(cap=0.1), measure) is not first
    assert measured == [None, None]


def test_an_unknown_relation_is_an_answer():
    store, measured = Store(), []
    for _ in range(2):
        assert store.column(QUERY, measured.append) is None
    assert measured == [None]


def squares(asked):
    """Measures squares of frame numbers where asked, and notes where that was."""

    def measure(near, at):
        asked.append(at.tolist())
        first = 0 if near is None else near.start
        return at, exact((at + first) ** 2.0, "number")

    return measure


@given(st.lists(st.lists(st.booleans(), min_size=9, max_size=9), max_size=5))
def test_a_costly_measurement_is_done_once_at_each_frame(masks):
    store, asked = Store(), []
    for mask in map(np.array, masks):
        found = store.partial(QUERY, mask, squares(asked))
        assert (found.lower[mask] == np.arange(9)[mask] ** 2).all()
        assert found.done[mask].all()
    frames = [frame for some in asked for frame in some]
    assert sorted(frames) == np.flatnonzero(np.any([*masks, [False] * 9], axis=0)).tolist()
    assert store.sparse_count == len(asked)


def test_a_measurement_may_answer_for_more_frames_than_were_asked():
    def everywhere(_, at):
        return np.arange(4), exact([5.0] * 4, "number")

    store = Store()
    assert store.partial(QUERY, np.array([True, False, False, False]), everywhere).done.all()


# ---- episodes that grow


def grown(store, frames):
    """Let the store go on; a stretch of frames stands for relations of them."""
    store.grow(frames, range)


@given(st.lists(st.integers(1, 6), min_size=1, max_size=6), st.data())
def test_a_growing_store_answers_as_one_of_the_whole(steps, data):
    """Whatever the steps, and whichever of them are asked about: at every frame the same."""
    values = np.random.default_rng(3).normal(size=40)
    store, frames, seen = GrowingStore(), 0, []

    def measure(near):
        seen.extend(near)
        return Series(values[near], values[near] + 1, "length", ("a note",))

    for step in steps:
        frames += step
        grown(store, frames)
        if data.draw(st.booleans()):
            found = store.series(QUERY, measure, Growth.PER_FRAME)
            assert np.array_equal(found.lower, values[:frames])
            assert np.array_equal(found.upper, values[:frames] + 1)
            assert found.notes == ("a note",)
    assert seen == sorted(set(seen))  # no frame twice


def test_what_any_frame_may_change_is_measured_anew_when_frames_come():
    store, lengths = GrowingStore(), []

    def measure(near):
        lengths.append(near)
        return exact(np.zeros(store.frames), "length")

    for frames in (3, 5):
        grown(store, frames)
        for _ in range(2):
            assert len(store.series(QUERY, measure)) == frames
    assert lengths == [None, None]


@pytest.mark.parametrize(("notes", "open_"), [((), False), (("derived from poses",), True)])
def test_the_last_frame_is_open_where_velocities_are_derived(notes, open_):
    store = GrowingStore()
    grown(store, 3)
    found = store.series(QUERY, lambda _: exact([1.0, 2.0, 3.0], "speed", notes), Growth.OPEN_END)
    assert found.known.tolist() == [True, True, not open_]


def test_costly_measurements_are_kept_while_frames_come():
    store, asked = GrowingStore(), []
    for frames in (4, 6):
        grown(store, frames)
        wanted = np.arange(frames) > 1
        found = store.partial(QUERY, wanted, squares(asked))
        assert (found.lower[wanted] == np.arange(frames)[wanted] ** 2).all()
    assert asked == [[0, 1], [0, 1]]  # counted from the first frame that is missing


def test_what_occurred_stays():
    store = GrowingStore()
    occurs = {0: "b", 3: "a"}
    for frames, all_ in ((2, ["b"]), (5, ["a", "b"])):
        grown(store, frames)
        found = store.items(QUERY, lambda near: [occurs[f] for f in near if f in occurs])
        assert found == all_
