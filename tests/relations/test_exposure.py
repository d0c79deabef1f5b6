"""Contamination: who has touched what had touched it, in the order in which things touched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import Scene

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
    found = Relations(Signals(scene.episode())).get("exposed_to", (a, b))
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


def test_a_table_is_exposed_but_passes_nothing_on() -> None:
    touches = [(0, "table", "b"), (2, "table", "a")]
    assert exposed(touches, "a", "b") == []
    assert exposed(touches, "table", "b") == since(0)
    assert exposed(touches, "a", "table") == since(2)


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


def test_without_forces_a_touch_is_a_distance_of_at_most_a_millimetre() -> None:
    for gap, expected in ((0.0009, since(5)), (0.0011, [])):
        x = np.where(np.arange(FRAMES) == 5, 0.02 + gap, 0.1)
        scene = Scene(FRAMES).box("a", 0.01, np.column_stack([x, 0 * x, 0 * x]))
        scene.box("b", 0.01, (0, 0, 0))
        facts = Relations(Signals(scene.episode(force_source="none")))
        assert np.flatnonzero(facts.get("exposed_to", ("a", "b"))).tolist() == expected
        assert "1 mm" in facts.caveat("exposed_to")[0]


@pytest.mark.parametrize("bodies", [("a", "b"), ("b", "a")])
def test_shapes_are_needed_then(bodies: tuple[str, str]) -> None:
    scene = Scene(2).box("a", 0.01, (0, 0, 0)).box("b", 0.01, (0, 0, 1))
    scene.bodies = [
        b.model_copy(update={"geoms": ()}) if b.name == "a" else b for b in scene.bodies
    ]
    facts = Relations(Signals(scene.episode(force_source="none")))
    assert facts.get("exposed_to", bodies) is None
    assert "shape of a" in facts.lacking("exposed_to", bodies)
