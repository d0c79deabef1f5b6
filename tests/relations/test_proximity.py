"""Support, grasp and dependence without forces: by distance and the lift test."""

import numpy as np
import pytest
from scenes import Scene
from told import doubt_of, holds

from safestage_eval.episode import Cavity, Geom, Tcp
from safestage_eval.evidence.measure import Signals
from safestage_eval.geometry.pose import rotate
from safestage_eval.relations.relations import Relations


def blind(scene: Scene) -> Relations:
    return Relations(Signals(scene.episode(force_source="none")))


@pytest.mark.parametrize(("gap", "truth"), [(-0.0005, True), (0.0009, True), (0.0011, False)])
def test_support_within_a_millimetre(gap: float, truth: bool) -> None:
    scene = Scene(3).fixed("table").box("a", 0.05, (0, 0, 0.05 + gap))
    facts = blind(scene)
    assert holds(facts, "supports", ("table", "a")).all() == truth
    assert holds(facts, "supported", ("a",)).all() == truth
    assert not holds(facts, "supports", ("a", "table")).any()
    assert "5 mm" in facts.caveat("supports")[0]


@pytest.mark.parametrize(("slope", "bears"), [(50, True), (58, True), (62, False), (80, False)])
def test_a_slope_bears_up_to_sixty_degrees(slope: float, bears: bool) -> None:
    """Raising a body by h opens the gap to a slope by h cos(slope): half of it at 60°."""
    half = np.deg2rad(slope) / 2
    turn = np.array([np.cos(half), 0, np.sin(half), 0])
    up = rotate(turn, (0, 0, 1.0))
    scene = Scene(2).body("ramp", Geom(kind="box", size=(0.5, 0.5, 0.02)), -0.02 * up, turn)
    scene.body("ball", Geom(kind="sphere", size=(0.03,)), 0.03 * up)
    assert holds(blind(scene), "supports", ("ramp", "ball")).all() == bears


def test_stack_and_bridge_depend_by_what_rests_on_what() -> None:
    scene = Scene(2).fixed("table").box("top", 0.02, (0.1, 0, 0.14))
    scene.box("board", (0.2, 0.05, 0.01), (0, 0, 0.11))
    for name, x in (("p", -0.12), ("q", 0.12)):
        scene.box(name, 0.05, (x, 0, 0.05))
    facts = blind(scene)
    for body, on in (("board", "p"), ("board", "q"), ("top", "board"), ("top", "p")):
        assert (facts.told("depends_on", (body, on)).upper == 1).all(), (body, on)
        assert not holds(facts, "depends_on", (on, body)).any(), (on, body)
    assert not holds(facts, "depends_on", ("p", "q")).any()
    share = facts.signal("load_share", ("top", "board"))
    assert (share.lower == 1).all()
    assert (
        not facts.signal("load_share", ("board", "p")).known.all()
        or (facts.signal("load_share", ("board", "p")).lower == 0).all()
    )
    assert np.allclose(facts.signal("edge_margin", ("top",)).value, 0.03, atol=1e-4)


def fingers(scene: Scene, at: np.ndarray, gap: float) -> Scene:
    for side, sign in (("left", 1), ("right", -1)):
        beside = at + np.array([-(0.06 + gap) * sign, 0, 0])
        scene.box(side, 0.01, beside, kind="gripper", finger=side)
    return scene


@pytest.mark.parametrize(("gap", "truth"), [(0.0005, True), (0.002, False)])
def test_held_by_the_shapes_of_two_fingers(gap: float, truth: bool) -> None:
    scene = Scene(2).box("a", 0.05, (0, 0, 0.5)).box("fruit", 0.02, (0, 0, 0.57))
    facts = blind(fingers(scene, np.array([0, 0, 0.5]), gap))
    assert holds(facts, "held", ("a",)).all() == truth
    assert holds(facts, "carried", ("fruit",)).all() == truth
    assert holds(facts, "carried", ("a",)).all() == truth
    assert not holds(facts, "held", ("fruit",)).any()


def test_held_by_going_along_with_a_hand_without_fingers() -> None:
    """Approach, grasp at 60, carry from 80 to 140, rest in the air to 180, set down and leave."""
    frames = 300
    s = np.arange(frames)
    carry = np.clip((s - 80) / 60, 0, 1) * 0.3
    lift = np.clip((s - 80) / 30, 0, 1) * 0.1 * (1 - np.clip((s - 180) / 30, 0, 1))
    away = np.clip((60 - s) / 60, 0, 1) * 0.3 + np.clip((s - 240) / 60, 0, 1) * 0.3
    body = np.column_stack([carry, 0 * s, 0.05 + lift])
    hand = body + np.column_stack([0 * s, 0 * s, 0.07 + away])
    scene = Scene(frames).fixed("table").box("a", 0.05, body).box("b", 0.05, (0, 0.2, 0.05))
    scene.box("hand", 0.015, hand, kind="gripper",
              tcp=Tcp(position=(0, 0, -0.05), orientation=(1, 0, 0, 0)))  # fmt: skip
    facts = blind(scene)
    held = holds(facts, "held", ("a",))
    assert not held[:70].any()
    assert held[82:208].all()
    assert not held[215:].any()
    open_, why = doubt_of(
        facts, "held", ("a",)
    )  # the still hand may have it already, or have let go
    assert open_[65:78].all()
    assert open_[215:235].all()
    assert not open_[:50].any()
    assert not open_[85:200].any()
    assert not open_[250:].any()
    assert "let go" in why
    assert not holds(facts, "held", ("b",)).any()
    assert doubt_of(facts, "held", ("b",)) is None
    assert "goes along" in facts.caveat("held")[0]


def accompanied(path: np.ndarray) -> Scene:
    """A box on a path (T, 3) with a hand above it that goes along all the time."""
    scene = Scene(len(path)).fixed("table").box("a", 0.05, path)
    return scene.box("hand", 0.015, path + np.array([0, 0, 0.07]), kind="gripper",
                     tcp=Tcp(position=(0, 0, -0.05), orientation=(1, 0, 0, 0)))  # fmt: skip


def line(*knots: tuple[float, float, float]) -> np.ndarray:
    """(T, 3) m: x and the height of the bottom over frames, straight between knots."""
    frame, x, z = np.transpose(knots)
    t = np.arange(int(frame[-1]) + 1)
    return np.column_stack([np.interp(t, frame, x), 0 * t, np.interp(t, frame, z) + 0.05])


@pytest.mark.parametrize(("way", "held"), [(0.025, True), (0.015, False)])
def test_going_along_for_two_centimetres_is_being_held(way: float, held: bool) -> None:
    facts = blind(accompanied(line((0, 0, 0), (30, 0, 0), (60, 0, way), (90, 0, way))))
    found = holds(facts, "held", ("a",))
    assert found[40:58].all() == held
    assert not found[:28].any()


@pytest.mark.parametrize(("frames", "open_"), [(24, True), (6, False)])
def test_what_does_not_fall_beside_a_still_hand_may_be_held(frames: int, open_: bool) -> None:
    """At 120 Hz: for 0.2 s, or for too short a time to tell."""
    facts = blind(accompanied(line((0, 0, 0.3), (frames - 1, 0, 0.3))))
    assert not holds(facts, "held", ("a",)).any()
    doubt = doubt_of(facts, "held", ("a",))
    assert (doubt is not None) == open_
    assert doubt is None or doubt[0].all()


def test_what_a_hand_may_bear_as_well_has_an_unknown_share_of_load() -> None:
    """Held by two fingers, or lying on the palm, and on the table too: nothing to all of it."""
    gripped = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    palm = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    palm.box("hand", (0.2, 0.02, 0.02), (0.24, 0, -0.02), kind="gripper")
    free = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    for scene, at, least in ((gripped, 0.0, 0), (palm, 2.0, 0), (free, 2.0, 1)):
        share = blind(fingers(scene, np.array([at, 0, 0.05]), 0)).signal(
            "load_share", ("a", "table")
        )
        assert (share.lower == least).all()
        assert (share.upper == 1).all()


MUG = Cavity(kind="cylinder", size=(0.04, 0.045), position=(0, 0, 0.005))


def mug(scene: Scene, tilt: float = 0.0) -> np.ndarray:
    """A mug of a floor and four walls, tilted about y; returns its orientation."""
    turn = np.array([np.cos(tilt / 2), 0, np.sin(tilt / 2), 0])
    floor = Geom(kind="box", size=(0.045, 0.045, 0.005), position=(0, 0, -0.045))
    walls = [
        Geom(kind="box", size=(0.003, 0.045, 0.05), position=(0.045 * s, 0, 0)) for s in (-1, 1)
    ]
    scene.body("mug", floor, (0, 0, 0.05), turn, cavity=MUG)
    geoms = (floor, *walls)
    scene.bodies[-1] = scene.bodies[-1].model_copy(update={"geoms": geoms})
    return turn


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("forces", [True, False])
def test_a_spoon_in_a_mug_and_a_fruit_above_it(tilt: float, forces: bool) -> None:
    """The spoon is longer than the mug is deep: its middle is outside, its foot on the floor."""
    scene = Scene(2)
    turn = mug(scene, tilt)

    def at(*place: float) -> np.ndarray:
        return np.array([0, 0, 0.05]) + rotate(turn, place)

    scene.body("spoon", Geom(kind="box", size=(0.004, 0.004, 0.1)), at(0.0, 0, 0.06), turn)
    scene.body("short", Geom(kind="box", size=(0.004, 0.004, 0.02)), at(0.02, 0, 0.0), turn)
    scene.body("fruit", Geom(kind="sphere", size=(0.03,)), at(0, 0, 0.3))
    scene.body("beside", Geom(kind="sphere", size=(0.03,)), at(0.12, 0, 0))
    scene.contact("mug", "spoon", at(0.0, 0, -0.04), (0, 0, 9.81))
    facts = Relations(Signals(scene.episode(force_source="recorded" if forces else "none")))
    assert holds(facts, "inside", ("spoon", "mug")).all() == (forces or tilt < np.pi / 3)
    assert holds(facts, "inside", ("short", "mug")).all()
    assert not holds(facts, "inside", ("fruit", "mug")).any()
    assert not holds(facts, "inside", ("beside", "mug")).any()


def test_what_may_lean_on_a_stack_may_fall_with_its_lowest() -> None:
    """The book touches only the can on top; whether it leans there is not known."""
    scene = Scene(2).fixed("table").box("target", 0.03, (0, 0, 0.03))
    scene.box("can", 0.04, (0, 0, 0.10)).box("book", (0.01, 0.05, 0.13), (0.0505, 0, 0.13))
    scene.box("far", 0.03, (0.4, 0, 0.03)).box("cup", 0.02, (-0.01, 0, 0.16))
    facts = Relations(Signals(scene.episode(force_source="none")))
    for on in ("target", "can"):
        assert not holds(facts, "depends_on", ("book", on)).any()
        assert doubt_of(facts, "depends_on", ("book", on))[0].all()
        assert doubt_of(facts, "depends_on", ("far", on)) is None
        assert doubt_of(facts, "depends_on", ("cup", on)) is None
    # the cup may be the weight without which the can tips
    assert not holds(facts, "depends_on", ("can", "cup")).any()
    assert doubt_of(facts, "depends_on", ("can", "cup"))[0].all()
