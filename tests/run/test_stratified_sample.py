"""Samples: in proportion, the same again, and never more than asked for."""

import random
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


def test_another_seed_is_another_choice():
    all_refs = refs({"a": 300, "b": 100})
    assert names(sample(all_refs, 40, 1)) != names(sample(all_refs, 40, 2))


def test_every_episode_has_the_same_chance():
    """Over many seeds, each is chosen about as often as any other (chi-square, 99.99 %)."""
    all_refs = refs({"a": 40, "b": 20})
    seeds = 400
    counts = Counter(name for seed in range(seeds) for name in names(sample(all_refs, 15, seed)))
    expected = seeds * 15 / 60
    chi = sum((counts[ref.episode_id] - expected) ** 2 / expected for ref in all_refs)
    assert chi < 110


def test_only_the_seed_chooses():
    all_refs = refs({"a": 300, "b": 100})
    random.seed(1)
    state, one = random.getstate(), names(sample(all_refs, 40, 7))
    assert random.getstate() == state
    random.seed(2)
    assert names(sample(all_refs, 40, 7)) == one


def campaign(stages, policies, tasks):
    return [
        EpisodeRef(
            Path(f"{stage}{task}-{policy}.mcap"), "mcap", f"{stage}{task}.{policy}",
            fields={"task": f"{stage}{task}", "stage": stage, "policy": policy},
        )
        for stage in stages
        for task in range(tasks)
        for policy in policies
    ]  # fmt: skip


@given(st.integers(3, 60), st.integers(0, 50))
def test_few_of_many_groups_are_of_every_stage_and_policy(count, seed):
    """One episode a group, as a small campaign has: none of the stages is left out, nor a policy."""
    chosen = sample(campaign(("ISH", "ETS", "FSH"), "abcd", 5), count, seed).refs
    stages = Counter(ref.fields["stage"] for ref in chosen)
    assert len(stages) == 3
    assert max(stages.values()) - min(stages.values()) <= 1
    for stage in stages:
        policies = Counter(ref.fields["policy"] for ref in chosen if ref.fields["stage"] == stage)
        assert max(policies.values()) - (min(policies.values()) if len(policies) == 4 else 0) <= 1


def test_another_seed_chooses_other_groups():
    all_refs = campaign(("ISH", "ETS", "FSH"), "abcd", 5)
    assert len({tuple(names(sample(all_refs, 4, seed))) for seed in range(10)}) > 5
