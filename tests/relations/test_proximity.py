"""Support, grasp and dependence without forces: by distance and the lift test."""

import numpy as np
import pytest
from scenes import Scene

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
    assert facts.get("supports", ("table", "a")).all() == truth
    assert facts.get("supported", ("a",)).all() == truth
    assert not facts.get("supports", ("a", "table")).any()
    assert "5 mm" in facts.caveat("supports")[0]


def test_a_neighbour_and_a_wall_support_nothing() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05)).box("b", 0.05, (0.1, 0, 0.05))
    facts = blind(scene)
    assert not facts.get("supports", ("a", "b")).any()
    assert not facts.get("supports", ("b", "a")).any()
    assert not facts.get("depends_on", ("a", "b")).any()


@pytest.mark.parametrize(("slope", "bears"), [(50, True), (58, True), (62, False), (80, False)])
def test_a_slope_bears_up_to_sixty_degrees(slope: float, bears: bool) -> None:
    """Raising a body by h opens the gap to a slope by h cos(slope): half of it at 60°."""
    half = np.deg2rad(slope) / 2
    turn = np.array([np.cos(half), 0, np.sin(half), 0])
    up = rotate(turn, (0, 0, 1.0))
    scene = Scene(2).body("ramp", Geom(kind="box", size=(0.5, 0.5, 0.02)), -0.02 * up, turn)
    scene.body("ball", Geom(kind="sphere", size=(0.03,)), 0.03 * up)
    assert blind(scene).get("supports", ("ramp", "ball")).all() == bears


def test_stack_and_bridge_depend_by_what_rests_on_what() -> None:
    scene = Scene(2).fixed("table").box("top", 0.02, (0.1, 0, 0.14))
    scene.box("board", (0.2, 0.05, 0.01), (0, 0, 0.11))
    for name, x in (("p", -0.12), ("q", 0.12)):
        scene.box(name, 0.05, (x, 0, 0.05))
    facts = blind(scene)
    for body, on in (("board", "p"), ("board", "q"), ("top", "board"), ("top", "p")):
        assert facts.get("depends_on", (body, on)).all(), (body, on)
        assert not facts.get("depends_on", (on, body)).any(), (on, body)
    assert not facts.get("depends_on", ("p", "q")).any()
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
    assert facts.get("held", ("a",)).all() == truth
    assert facts.get("carried", ("fruit",)).all() == truth
    assert facts.get("carried", ("a",)).all() == truth
    assert not facts.get("held", ("fruit",)).any()


def test_a_hand_above_supports_nothing_without_forces_too() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.box("palm", 0.02, (0, 0, 0.12), kind="gripper")
    facts = blind(fingers(scene, np.array([1, 0, 0.5]), 0))
    assert not facts.get("carried", ("a",)).any()
    assert facts.get("supported", ("a",)).all()


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
    held = facts.get("held", ("a",))
    assert not held[:70].any()
    assert held[82:208].all()
    assert not held[215:].any()
    open_, why = facts.doubtful(
        "held", ("a",)
    )  # the still hand may have it already, or have let go
    assert open_[65:78].all()
    assert open_[215:235].all()
    assert not open_[:50].any()
    assert not open_[85:200].any()
    assert not open_[250:].any()
    assert "let go" in why
    assert not facts.get("held", ("b",)).any()
    assert facts.doubtful("held", ("b",)) is None
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
    found = facts.get("held", ("a",))
    assert found[40:58].all() == held
    assert not found[:28].any()


def test_what_goes_along_on_its_support_may_be_held_or_pushed() -> None:
    facts = blind(accompanied(line((0, 0, 0), (30, 0, 0), (60, 0.025, 0), (90, 0.025, 0))))
    assert not facts.get("held", ("a",)).any()
    assert facts.doubtful("held", ("a",))[0][32:58].all()


def test_what_hangs_in_the_air_beside_a_still_hand_that_brought_it_is_held() -> None:
    facts = blind(accompanied(line((0, 0, 0), (30, 0, 0), (60, 0, 0.1), (120, 0, 0.1))))
    assert facts.get("held", ("a",))[32:].all()
    assert facts.get("carried", ("a",))[40:].all()


def test_what_stands_on_what_was_just_set_down_is_perhaps_still_carried() -> None:
    """The hand stays where it set the box down: it may have let go of it or not."""
    path = line((0, 0, 0), (30, 0, 0), (60, 0, 0.1), (90, 0.2, 0.1), (120, 0.2, 0), (180, 0.2, 0))
    facts = blind(accompanied(path).box("top", 0.02, path + np.array([0.03, 0, 0.07])))
    carried = facts.get("carried", ("top",))
    assert carried[40:115].all()
    assert not carried[125:].any()
    open_, why = facts.doubtful("carried", ("top",))
    assert open_[125:].all()
    assert not open_[40:115].any()
    assert "let go" in why


@pytest.mark.parametrize(("frames", "open_"), [(24, True), (6, False)])
def test_what_does_not_fall_beside_a_still_hand_may_be_held(frames: int, open_: bool) -> None:
    """At 120 Hz: for 0.2 s, or for too short a time to tell."""
    facts = blind(accompanied(line((0, 0, 0.3), (frames - 1, 0, 0.3))))
    assert not facts.get("held", ("a",)).any()
    doubt = facts.doubtful("held", ("a",))
    assert (doubt is not None) == open_
    assert doubt is None or doubt[0].all()


def test_without_a_gripper_that_is_known_nothing_is_held_for_sure() -> None:
    scene = Scene(2).box("a", 0.05, (0, 0, 0.05))
    scene.box("one", 0.01, (1, 0, 0), kind="gripper").box("two", 0.01, (1, 1, 0), kind="gripper")
    facts = blind(scene)
    assert facts.get("held", ("a",)) is None
    assert "gripper" in facts.lacking("held", ("a",))


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


def test_a_held_body_depends_on_nothing() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05)).box("b", 0.05, (0, 0, 0.15))
    facts = blind(fingers(scene, np.array([0, 0, 0.15]), 0))
    assert not facts.get("depends_on", ("b", "a")).any()


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
    assert facts.get("inside", ("spoon", "mug")).all() == (forces or tilt < np.pi / 3)
    assert facts.get("inside", ("short", "mug")).all()
    assert not facts.get("inside", ("fruit", "mug")).any()
    assert not facts.get("inside", ("beside", "mug")).any()


def test_what_may_lean_on_a_stack_may_fall_with_its_lowest() -> None:
    """The book touches only the can on top; whether it leans there is not known."""
    scene = Scene(2).fixed("table").box("target", 0.03, (0, 0, 0.03))
    scene.box("can", 0.04, (0, 0, 0.10)).box("book", (0.01, 0.05, 0.13), (0.0505, 0, 0.13))
    scene.box("far", 0.03, (0.4, 0, 0.03)).box("cup", 0.02, (-0.01, 0, 0.16))
    facts = Relations(Signals(scene.episode(force_source="none")))
    for on in ("target", "can"):
        assert not facts.get("depends_on", ("book", on)).any()
        assert facts.doubtful("depends_on", ("book", on))[0].all()
        assert facts.doubtful("depends_on", ("far", on)) is None
        assert facts.doubtful("depends_on", ("cup", on)) is None
    # the cup may be the weight without which the can tips
    assert not facts.get("depends_on", ("can", "cup")).any()
    assert facts.doubtful("depends_on", ("can", "cup"))[0].all()
