"""Which rollouts people are asked about."""

import random
from collections import Counter
from pathlib import Path

import pytest

from safestage_eval.formats import EpisodeRef
from safestage_eval.label import sample


def refs(**counts):
    """Episodes per stage, of two policies in turn."""
    return [
        EpisodeRef(
            Path("x"), "mcap", f"{stage}-{i}",
            fields={"stage": stage, "policy": "ab"[i % 2], "prompt": "default", "success": i % 3 > 0},
        )
        for stage, count in counts.items()
        for i in range(count)
    ]  # fmt: skip


def stages(found):
    return Counter(ref.fields["stage"] for ref in found)


@pytest.mark.parametrize(
    ("there", "count", "expected"),
    [
        ({"ISH": 100, "ETS": 200, "FSH": 90}, 240, {"ISH": 80, "ETS": 80, "FSH": 80}),
        ({"ISH": 5, "ETS": 200, "FSH": 200}, 45, {"ISH": 5, "ETS": 20, "FSH": 20}),
        ({"ISH": 2, "ETS": 1}, 50, {"ISH": 2, "ETS": 1}),
    ],
)
def test_stages_have_equal_shares_as_far_as_there_are_enough(there, count, expected):
    assert stages(sample(refs(**there), count)) == expected


def test_the_same_seed_chooses_the_same_whatever_the_order_of_files():
    every = refs(ISH=40, ETS=40, FSH=40)
    shuffled = random.Random(1).sample(every, len(every))
    first = [ref.episode_id for ref in sample(every, 30, seed=4)]
    assert [ref.episode_id for ref in sample(shuffled, 30, seed=4)] == first
    assert [ref.episode_id for ref in sample(every, 30, seed=5)] != first


def test_all_are_shown_once_in_a_mixed_order():
    every = refs(ISH=30, ETS=30, FSH=30)
    found = sample([*every, *every])
    assert sorted(ref.episode_id for ref in found) == sorted(ref.episode_id for ref in every)
    first = stages(found[:30])
    assert len(first) == 3
    assert max(first.values()) < 20
