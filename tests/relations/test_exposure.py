"""Contamination: who has touched what had touched it, in the order in which things touched."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scenes import Scene
from told import holds

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

FRAMES = 12


def exposed(touches: list[tuple[int, str, str]], a: str, b: str, names: str = "abcd") -> list[int]:
    """The frames at which a is exposed to b, with touches (frame, one, other)."""
    scene = Scene(FRAMES).fixed("table")
    for i, name in enumerate(names):
        scene.box(name, 0.01, (i, 0, 5))
    for side in ("left", "right"):
        scene.box(side, 0.01, (0, 9, 5), kind="gripper", finger=side)
    for frame, one, other in touches:
        scene.contact(one, other, (0, 0, 5), (0, 0, 1), frames=slice(frame, frame + 1))
    found = holds(Relations(Signals(scene.episode())), "exposed_to", (a, b))
    assert found is not None
    return np.flatnonzero(found).tolist()


def since(frame: int) -> list[int]:
    return list(range(frame, FRAMES))


def test_a_touch_exposes_for_good_and_both_ways() -> None:
    assert exposed([(4, "a", "b")], "a", "b") == since(4)
    assert exposed([(4, "a", "b")], "b", "a") == since(4)
    assert exposed([(4, "a", "b")], "c", "b") == []


def test_the_order_of_touches_matters() -> None:
    assert exposed([(3, "left", "b"), (6, "left", "a")], "a", "b") == since(6)
    assert exposed([(6, "left", "b"), (3, "left", "a")], "a", "b") == []
    assert exposed([(6, "left", "b"), (3, "left", "a"), (8, "left", "a")], "a", "b") == since(8)


def test_the_other_finger_is_clean_and_the_hand_is_their_union() -> None:
    touches = [(3, "left", "b"), (6, "right", "a")]
    assert exposed(touches, "a", "b") == []
    assert exposed(touches, "gripper", "b") == since(3)
    assert exposed(touches, "a", "gripper") == since(6)


@given(st.lists(st.tuples(st.integers(0, FRAMES - 1), st.sampled_from(
    [(x, y) for x in "abcd" for y in "abcd" if x < y])), max_size=8))  # fmt: skip
def test_against_a_step_by_step_simulation(touches: list[tuple[int, tuple[str, str]]]) -> None:
    """Let what is exposed spread frame by frame until nothing changes."""
    dirty, expected = {"b"}, []
    for frame in range(FRAMES):
        for _ in "abcd":
            for _, pair in (t for t in touches if t[0] == frame):
                if dirty & set(pair):
                    dirty |= set(pair)
        if "a" in dirty:
            expected.append(frame)
    assert exposed([(f, *pair) for f, pair in touches], "a", "b") == expected
