"""Whether the robot, or what it has, presses on a body: by forces, and by shapes where there are none."""

import pytest
from scenes import G, Scene
from told import doubt_of, holds, why_unknown

from safestage_eval.episode import Body
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations


def scene(gap: float = 0.0, mass: float = 1.0) -> Scene:
    """A box on a table; a finger and a can beside it, each at a distance; a second finger beyond the can."""
    out = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05), mass=mass)
    out.rests("a", "table", 0.05, (0, 0, 0), mass * G)
    out.box("can", 0.02, (0.07 + gap, 0, 0.05))
    out.box("left", 0.01, (-0.06 - gap, 0, 0.05), kind="gripper", finger="left")
    return out.box("right", 0.01, (0, 0, 1), kind="gripper", finger="right")


def pressed(on: Scene, by: str, force: float) -> Scene:
    sign = -1.0 if by == "can" else 1.0
    return on.contact(by, "a", (-0.05 * sign, 0, 0.05), (force * sign, 0, 0), (sign, 0, 0))


def gripped(on: Scene) -> Scene:
    """The can, by both fingers, from below and above."""
    for finger, sign in (("left", 1), ("right", -1)):
        on.contact(finger, "can", (0.07, 0, 0.05 - 0.02 * sign), (0, 0, 5.0 * sign), (0, 0, sign))
    return on


def leaned_on(found: Scene, **header: object) -> tuple[bool, bool]:
    """The truth, and whether it is open."""
    relations = Relations(Signals(found.episode(**header)))
    truth, doubt = holds(relations, "leaned_on", ("a",)), doubt_of(relations, "leaned_on", ("a",))
    return bool(truth.all()), doubt is not None and bool(doubt[0].all())


@pytest.mark.parametrize(
    ("mass", "force", "truth"),
    [
        (1.0, 0.11, True),
        (1.0, 0.09, False),
        (0.01, 0.011, True),  # a tenth of its weight
        (0.01, 0.009, False),
        (100.0, 0.11, True),
    ],
)
def test_a_finger_presses_with_a_tenth_of_the_weight_or_as_a_contact(
    mass: float, force: float, truth: bool
) -> None:
    assert leaned_on(pressed(scene(mass=mass), "left", force)) == (truth, False)


def test_what_the_robot_holds_presses_and_what_it_does_not_hold_leans_by_itself() -> None:
    assert leaned_on(pressed(scene(), "can", 1.0)) == (False, False)
    assert leaned_on(gripped(pressed(scene(), "can", 1.0))) == (True, False)
    assert leaned_on(gripped(scene())) == (False, False)


@pytest.mark.parametrize(
    ("gap", "truth", "open_"),
    [(-0.0012, True, False), (-0.0008, False, True), (0.0009, False, True), (0.0011, False, False)],
)
def test_without_forces_it_is_open_within_a_millimetre(
    gap: float, truth: bool, open_: bool
) -> None:
    """The verdict that force would give is never the opposite one."""
    assert leaned_on(scene(gap), force_source="none") == (truth, open_)


def test_without_forces_a_link_of_unknown_shape_leaves_it_unknown() -> None:
    found = scene(0.01).episode(force_source="none")
    link = Body(name="link", kind="robot", mass=1.0)
    header = found.header.model_copy(update={"bodies": (*found.header.bodies, link)})
    tracks = {**found.tracks, "link": found.tracks["left"]}
    seen = type(found)(header, found.t, tracks, found.contacts, found.frames)
    assert "no shape of link" in why_unknown(Relations(Signals(seen)), "leaned_on", ("a",))
