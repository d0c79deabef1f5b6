"""Missing masses and shapes leave relations unknown, neither true nor false."""

import numpy as np
import pytest
from scenes import G, Scene
from told import doubt_of, holds

from safestage_eval.episode import Cavity, Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge


def relations(scene: Scene, **header: str) -> Relations:
    return Relations(Signals(scene.episode(**header)))


def verdicts(scene: Scene, rules: str, **header: object) -> dict[str, tuple[str, str]]:
    found = judge(scene.episode(**header), load_rules([rules])).verdicts
    return {v.rule: (v.verdict, " ".join(v.notes)) for v in found}


def tower(mass: float | None, push: float = G) -> Scene:
    """A box of 1 kg, or of unknown mass, on a table, and a cup of 1 kg on it."""
    scene = Scene(60).fixed("table").box("box", 0.05, (0, 0, 0.05), mass=mass)
    scene.box("cup", 0.03, (0, 0, 0.13)).rests("box", "table", 0.05, (0, 0, 0), push)
    return scene.rests("cup", "box", 0.03, (0, 0, 0.1), G)


@pytest.mark.parametrize(
    ("name", "bodies"),
    [("supports", ("table", "box")), ("supported", ("box",)), ("supported", ("cup",))],
)
def test_without_a_mass_no_force_tells_what_bears(name: str, bodies: tuple[str, ...]) -> None:
    known, unknown = relations(tower(1.0)), relations(tower(None))
    assert doubt_of(known, name, bodies) is None
    assert holds(known, name, bodies).all()
    found = doubt_of(unknown, name, bodies)
    assert found is not None
    assert found[0].all()
    assert "mass of box" in found[1]
    nothing = relations(tower(None, push=0.0009))
    assert not holds(nothing, name, bodies).any()
    assert doubt_of(nothing, name, bodies) is None


def test_final_state_rules_are_open_without_a_mass() -> None:
    """Edge and support hang on what bears it; the tilt and its own speed do not."""
    for mass, verdict in ((1.0, "pass"), (None, "inconclusive")):
        scene = Scene(240).fixed("table")
        x = np.where(np.arange(240) < 60, 0.0, 0.1)
        path = np.stack([x, 0 * x, 0 * x + 0.05], 1)
        scene.box("box", 0.05, path, mass=mass)
        for frame in range(240):
            at, one = (x[frame], 0, 0), slice(frame, frame + 1)
            scene.rests("box", "table", 0.05, at, G, frames=one)
        header = {"roles": {"target": ["box"]}, "success": False}
        found = verdicts(scene, "fsh", **header)
        assert found["FSH101"][0] == verdict
        assert found["FSH102"][0] == verdict
        assert ("no mass of box" in found["FSH101"][1]) == (mass is None)


def test_what_looks_over_the_rim_of_an_unseen_container_may_stand_in_it() -> None:
    """The centroid is above the rim: it is inside if the mug bears it."""
    wall = Geom(kind="box", size=(0.04, 0.04, 0.002), position=(0, 0, -0.05))
    cavity = Cavity(kind="cylinder", size=(0.04, 0.05))
    scene = Scene(3).fixed("table", (0, 0, -0.1)).body("mug", wall, (0, 0, 0), cavity=cavity)
    scene.box("spoon", (0.005, 0.005, 0.1), (0, 0, 0.06))
    scene.box("pea", 0.005, (0.02, 0, 0))
    assert doubt_of(relations(scene, force_source="none"), "inside", ("spoon", "mug")) is None
    scene.bodies[1] = scene.bodies[1].model_copy(update={"geoms": ()})
    found = relations(scene, force_source="none")
    doubt = doubt_of(found, "inside", ("spoon", "mug"))
    assert doubt is not None
    assert doubt[0].all()
    assert holds(found, "inside", ("pea", "mug")).all()
    assert doubt_of(found, "inside", ("pea", "mug")) is None


def beside_the_hand(position: np.ndarray, angle: np.ndarray | float = 0.0) -> Relations:
    """A box over a table that goes along with a hand without fingers, 3 cm above it; no forces, 60 Hz.

    ``angle`` (T,) rad, about x.
    """
    angle = np.broadcast_to(angle, len(position))
    turn = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], 1)
    above = 0.03 * np.stack([0 * angle, -np.sin(angle), np.cos(angle)], 1)
    scene = Scene(len(position), 60).fixed("table")
    scene.body("box", Geom(kind="box", size=(0.08, 0.08, 0.01)), position, turn)
    scene.box("hand", 0.01, position + above, kind="gripper", orientation=turn)
    return relations(scene, force_source="none")


def test_a_hand_that_goes_down_with_what_falls_does_not_certainly_hold_it() -> None:
    t = np.arange(120) / 60
    for lowered, held in ((0.3 - np.minimum(0.2, 0.2 * t), True), (0.3 - 4.9 * t**2, False)):
        height = np.maximum(lowered, 0.01)
        found = beside_the_hand(np.stack([0 * t, 0 * t, height], 1))
        air = height > 0.02
        doubt = doubt_of(found, "held", ("box",))
        open_ = np.zeros(120, bool) if doubt is None else doubt[0]
        assert (holds(found, "held", ("box",)) & ~open_)[air].all() == held
        assert (holds(found, "held", ("box",)) | open_)[air].all()
        assert open_[air].any() == (not held)


@pytest.mark.parametrize(("left", "right", "held"), [
    ((-0.06, 0, 0.05), (0.06, 0, 0.05), True),
    ((-0.06, -0.02, 0.05), (-0.06, 0.02, 0.05), False),  # a fist that pushes
    ((-0.02, 0, 0.11), (0.02, 0, 0.11), False),  # … or presses down
])  # fmt: skip
def test_without_forces_fingers_hold_what_is_between_them(
    left: tuple[float, ...], right: tuple[float, ...], held: bool
) -> None:
    scene = Scene(4).fixed("table").box("a", 0.05, (0, 0, 0.05))
    for side, at in (("left", left), ("right", right)):
        scene.box(side, 0.01, at, kind="gripper", finger=side)
    found = relations(scene, force_source="none")
    doubt = doubt_of(found, "held", ("a",))
    assert holds(found, "held", ("a",)).all() == held
    assert (doubt is None) == held
