"""The support graph: bearing, paths to fixtures, what the robot carries."""

import numpy as np
import pytest
from scenes import G, Scene
from told import holds, why_unknown

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations


def relations(scene: Scene) -> Relations:
    return Relations(Signals(scene.episode()))


def gripped(scene: Scene, body: str, x: float, z: float, lift: float) -> Scene:
    """Two fingers squeeze the body with 20 N and lift it with ``lift`` N in all."""
    for side, sign in (("left", 1), ("right", -1)):
        name = f"finger_{side}"
        scene.box(name, 0.01, (x - 0.06 * sign, 0, z), kind="gripper", finger=side)
        scene.contact(
            name, body, (x - 0.05 * sign, 0, z), (20 * sign, 0, lift / 2), normal=(sign, 0, 0)
        )
    return scene


def test_bearing_needs_a_tenth_of_the_weight() -> None:
    scene = Scene(4).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.rests("a", "table", 0.05, (0, 0, 0), 0.11 * G, frames=slice(0, 2))
    scene.rests("a", "table", 0.05, (0, 0, 0), 0.09 * G, frames=slice(2, 4))
    found = relations(scene)
    assert holds(found, "supports", ("table", "a")).tolist() == [True, True, False, False]
    assert not holds(found, "supports", ("a", "table")).any()


def test_a_gripper_pressing_down_supports_nothing() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.box("palm", 0.02, (0, 0, 0.12), kind="gripper")
    for side, x in (("left", 0.2), ("right", -0.2)):
        scene.box(side, 0.01, (x, 0, 0.2), kind="gripper", finger=side)
    scene.rests("a", "table", 0.05, (0, 0, 0), G + 5)
    scene.contact("palm", "a", (0, 0, 0.1), (0, 0, -5))
    found = relations(scene)
    assert not holds(found, "supports", ("palm", "a")).any()
    assert not holds(found, "carried", ("a",)).any()
    assert not holds(found, "held", ("a",)).any()
    assert holds(found, "supported", ("a",)).all()


def pinched(*fingers: tuple[str, str, tuple[float, float, float]], mass: float = 1.0) -> Relations:
    """A box on a table; each finger: name, side, force on the box (N), along its normal."""
    scene = Scene(1).fixed("table").box("a", 0.05, (0, 0, 0.05), mass=mass)
    for arm in ("one", "two"):
        scene.box(arm, 0.02, (0, 0, 0.5), kind="gripper")
    for name, side, force in fingers:
        push = np.array(force, float)
        normal = push / np.linalg.norm(push)
        at = np.array([0, 0, 0.05]) - 0.05 * normal
        scene.box(name, 0.01, at, kind="gripper", finger=side, parent=name.partition("_")[0])
        scene.contact(name, "a", at, push, normal=normal)
    return relations(scene)


@pytest.mark.parametrize(
    ("left", "right", "held"),
    [
        ((20, 0, 0), (-20, 0, 0), True),
        ((0, 0, -20), (0, 0, -20), False),  # a fist that presses down
        ((20, 0, 0), (20, 0, 0), False),  # … or pushes
        ((14, 14, 0), (-15, 14, 0), True),  # 91° apart
        ((14, 14, 0), (-13, 14, 0), False),  # 89°
        ((1e-6, 0, 0), (-1e-6, 0, 0), False),
        ((20, 0, 0), (-0.48, 0, 0), False),  # less than a twentieth of the weight
        ((20, 0, 0), (-0.50, 0, 0), True),
    ],
)
def test_fingers_hold_from_opposing_sides(left: object, right: object, held: bool) -> None:
    found = pinched(("one_left", "left", left), ("one_right", "right", right))  # type: ignore[arg-type]
    assert holds(found, "held", ("a",)).all() == held


@pytest.mark.parametrize(("force", "held"), [(0.21, True), (0.19, False)])
def test_what_is_light_is_held_by_two_tenths_of_a_newton(force: float, held: bool) -> None:
    found = pinched(
        ("one_left", "left", (force, 0, 0)), ("one_right", "right", (-force, 0, 0)), mass=0.01
    )
    assert holds(found, "held", ("a",)).all() == held


def test_what_lifts_it_carries_it_and_supports_nothing() -> None:
    """The fingers bear it from a tenth of its weight on; no finger is a support of it."""
    for lift, carried in ((0.12 * G, True), (0.08 * G, False)):
        scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
        scene.rests("a", "table", 0.05, (0, 0, 0), G - lift)
        found = relations(gripped(scene, "a", 0, 0.05, lift))
        assert holds(found, "carried", ("a",)).all() == carried
        assert holds(found, "carried", ("a",)).any() == carried
        assert holds(found, "held", ("a",)).all()
        assert not holds(found, "supports", ("finger_left", "a")).any()
        assert holds(found, "supported", ("a",)).all()


def test_fruit_in_a_carried_bowl_is_carried_not_held() -> None:
    scene = Scene(2).fixed("table").box("bowl", 0.05, (0, 0, 0.3)).box("fruit", 0.02, (0, 0, 0.37))
    scene.rests("fruit", "bowl", 0.02, (0, 0, 0.35), G)
    gripped(scene, "bowl", 0, 0.3, 2 * G)
    found = relations(scene)
    assert holds(found, "held", ("bowl",)).all()
    assert holds(found, "carried", ("fruit",)).all()
    assert not holds(found, "held", ("fruit",)).any()
    assert not holds(found, "supported", ("fruit",)).any()


@pytest.mark.parametrize("touching", [("left",), ("right",), ("left", "palm"), ("palm",)])
def test_one_finger_or_the_palm_holds_nothing(touching: tuple[str, ...]) -> None:
    scene = (
        Scene(2)
        .fixed("table")
        .box("a", 0.05, (0, 0, 0.05))
        .box("palm", 0.02, (0, 0, 0.5), kind="gripper")
    )
    scene.rests("a", "table", 0.05, (0, 0, 0), G)
    for side in ("left", "right"):
        scene.box(side, 0.01, (0, 0, 0.5), kind="gripper", finger=side)
    for name in touching:
        scene.contact(name, "a", (0, 0.05, 0.05), (0, -20, 0), normal=(0, -1, 0))
    assert not holds(relations(scene), "held", ("a",)).any()


def test_support_is_inherited_down_to_the_fixture() -> None:
    scene = Scene(2).fixed("table")
    for i, name in enumerate("abc"):
        scene.box(name, 0.05, (0, 0, 0.05 + 0.1 * i))
    scene.rests("b", "a", 0.05, (0, 0, 0.1), 2 * G).rests("c", "b", 0.05, (0, 0, 0.2), G)
    assert not holds(relations(scene), "supported", ("c",)).any()  # a hangs in the air
    scene.rests("a", "table", 0.05, (0, 0, 0), 3 * G)
    assert holds(relations(scene), "supported", ("c",)).all()


def test_a_gripper_without_named_fingers_holds_nobody_knows_what() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.box("hand", 0.02, (0, 0, 0.12), kind="gripper")
    scene.rests("a", "table", 0.05, (0, 0, 0), G)
    found = relations(scene)
    assert "finger" in why_unknown(found, "held", ("a",))
