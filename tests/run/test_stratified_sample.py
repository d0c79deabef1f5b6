"""Samples: in proportion, the same again, and never more than asked for."""

from collections import Counter
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.formats import EpisodeRef
from safestage_eval.run.stratified_sample import sample


def refs(sizes):
    return [
        EpisodeRef(
            Path(f"{task}-{i}.mcap"), "mcap", f"{task}.{i}", fields={"task": task, "stage": "FSH"}
        )
        for task, size in sizes.items()
        for i in range(size)
    ]


@given(
    st.dictionaries(st.text("abc", min_size=1, max_size=3), st.integers(1, 40), min_size=1),
    st.integers(1, 60),
    st.integers(0, 3),
)
def test_shares_are_in_proportion(sizes, count, seed):
    all_refs = refs(sizes)
    chosen, note = sample(all_refs, count, seed)
    total = sum(sizes.values())
    assert len(chosen) == min(count, total)
    assert bool(note) == (count < total)
    places = [all_refs.index(ref) for ref in chosen]
    assert places == sorted(set(places))
    found = Counter(ref.fields["task"] for ref in chosen)
    for task, size in sizes.items():
        exact = size * min(count, total) / total
        assert exact - 1 < found[task] < exact + 1


@given(st.randoms())
def test_the_same_ones_in_whatever_order_they_come(shuffler):
    all_refs = refs({"a": 30, "b": 50, "c": 7})
    mixed = list(all_refs)
    shuffler.shuffle(mixed)
    assert set(names(sample(mixed, 20))) == set(names(sample(all_refs, 20)))


def names(found):
    return [ref.episode_id for ref in found.refs]
