"""Pictures of earlier moments are of the moments that were asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from simulate.cameras.lookback import Lookback


def of(step: int) -> dict[str, Any]:
    return {"wrist": np.full((1, 1, 3), step, np.uint16)}


@settings(max_examples=80, deadline=None)
@given(back=st.lists(st.integers(1, 40), min_size=1, max_size=4), length=st.integers(1, 30))
def test_every_request_has_exactly_what_it_looks_back_to(back: list[int], length: int) -> None:
    """And no more is drawn than some request wants."""
    looking, drawn, used = Lookback(back), set(), set()
    for step in range(length * 6 + 1):
        played = step % length
        if played == 0:
            looking.keep(step, of(step))
            got = [int(images["wrist"][0, 0, 0]) for images in looking.past(step)]
            assert got == [max(step - b, 0) for b in sorted(set(back), reverse=True)]
            used.update(got)
        elif looking.due(played, length):
            looking.keep(step, of(step))
            drawn.add(step)
    over = length * 6 - max(back)
    assert {step for step in drawn if step < over} <= used


def test_nothing_is_kept_for_those_who_do_not_look_back() -> None:
    looking = Lookback(())
    looking.keep(0, of(0))
    assert looking.past(0) == ()
    assert not any(looking.due(played, 8) for played in range(1, 8))


def test_answers_of_unequal_lengths_give_the_picture_next_in_time() -> None:
    looking = Lookback([10])
    for step in (0, 8, 11):
        looking.keep(step, of(step))
    assert [int(i["wrist"][0, 0, 0]) for i in looking.past(20)] == [11]
