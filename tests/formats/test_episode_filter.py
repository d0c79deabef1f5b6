"""Which episodes are meant, and what is said where none is."""

from pathlib import Path

import pytest

from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.episode_filter import Selection


def ref(number: int, problem: str = "", **fields: object) -> EpisodeRef:
    said = TraceError("x", problem) if problem else None
    return EpisodeRef(Path(f"{number}.mcap"), "mcap", f"e{number}", fields=fields, problem=said)


HERE = [
    ref(1, task="stack", policy="Mine", seed=0),
    ref(2, task="pour", policy="theirs", seed=None),
    ref(3, "it is cut off"),
    ref(4, task="pour", policy="theirs", seed=1, termination="error"),
]


@pytest.mark.parametrize(
    ("where", "ids"),
    [
        ({}, ["e1", "e2", "e3"]),
        ({"policy": "mine"}, ["e1", "e3"]),
        ({"policy": "theirs", "task": "pour"}, ["e2", "e3"]),
        ({"episode_id": "E2"}, ["e2", "e3"]),
        ({"seed": ""}, ["e2", "e3"]),
        ({"termination": "error"}, ["e3", "e4"]),
    ],
)
def test_those_with_the_values_and_those_that_cannot_be_read(where, ids):
    chosen = Selection(HERE, where)
    assert [found.episode_id for found in chosen] == ids
    assert chosen.aborted == ([] if "termination" in where else ["e4"])


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ({"polcy": "mine"}, 'no field \'polcy\'. Allowed: episode_id, policy, seed, task. Fix: did you mean "policy"?'),
        ({"policy": "mime"}, 'none of 4 episodes matches. Allowed: policy Mine, theirs. Fix: did you mean "policy=Mine"?'),
        ({"task": "pour", "seed": "0"}, "task=pour and seed=0: none of 4 episodes matches. Allowed: task pour, stack; seed 0."),
        ({"family": "x"}, "no field 'family'."),
    ],
)  # fmt: skip
def test_where_none_is_meant_the_values_are_reported(where, said):
    with pytest.raises(InputError) as caught:
        list(Selection(HERE, where))
    assert said in str(caught.value)


def test_a_misspelt_field_is_reported_before_the_others():
    def found():
        yield ref(1, task="stack")
        raise AssertionError("was asked for more")

    with pytest.raises(InputError, match="no field"):
        list(Selection(found(), {"tsak": "stack"}))


def test_where_all_ended_in_an_error():
    with pytest.raises(InputError, match="every one of them ended in an error"):
        list(Selection([ref(4, task="pour", termination="error")], {}))
