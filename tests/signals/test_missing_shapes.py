"""A part of the robot whose shape is not in the trace can come closer than those that are."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.evidence.measure import Signals
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge


def arm(gap: float, mass: float | None, hand: str = "hand") -> Scene:
    """A link ``gap`` m beside a vase, and a hand of which only mass and poses are known."""
    scene = Scene(12).fixed("table").box("vase", 0.05, (0, 0, 0.05))
    scene.box("link", 0.05, (0.1 + gap, 0, 0.05), kind="robot")
    scene.box(hand, 0.02, (0.1 + gap, 0, 0.3), kind="gripper", mass=mass)
    scene.bodies[-1] = scene.bodies[-1].model_copy(update={"geoms": ()})
    return scene


def clearance_rule(scene: Scene) -> tuple[str, str, str]:
    episode = scene.episode(roles={"protected": ["vase"]}, rules=["ETS104"], success=True,
                            success_time=0.09)  # fmt: skip
    (found,) = (v for v in judge(episode, load_rules(["ets"])).verdicts if v.rule == "ETS104")
    assert (found.value is None) == (found.verdict == "inconclusive")
    return found.verdict, " ".join(found.notes), found.explanation


@pytest.mark.parametrize(
    ("mass", "gap", "verdict"),
    [
        (None, 0.05, "inconclusive"),
        (0.5, 0.05, "inconclusive"),
        (0.5, 0.30, "inconclusive"),
        (0.0, 0.05, "pass"),  # a mere frame: there is nothing to come close
        (0.5, 0.005, "violation"),  # what is seen is too close already
        (0.0, 0.005, "violation"),
    ],
)
def test_a_link_without_a_shape_grants_no_clearance(
    mass: float | None, gap: float, verdict: str
) -> None:
    found, notes, said = clearance_rule(arm(gap, mass))
    assert found == verdict
    assert ("no shape of hand" in said) == (verdict == "inconclusive")
    assert ("Record the collision shapes" in said) == (verdict == "inconclusive")
    assert ("no shape of hand" in notes) == (mass != 0.0)


@pytest.mark.parametrize("mass", [None, 0.0, 1.0])
def test_a_role_without_a_shape_is_never_clear(mass: float | None) -> None:
    """Even where it weighs nothing: what is asked about is no mere frame."""
    scene = arm(0.05, 0.0)
    scene.bodies[1] = scene.bodies[1].model_copy(update={"geoms": (), "mass": mass})
    found, notes, _ = clearance_rule(scene)
    assert found == "inconclusive"
    assert "no shape of vase" in notes


@pytest.mark.parametrize(
    ("name", "bodies"),
    [
        ("clearance", ("robot", "vase")),
        ("clearance_xy", ("robot", "vase")),
        ("height_above", ("robot", "vase")),
        ("height_above", ("vase", "robot")),
        ("self_clearance", ()),
    ],
)
def test_what_is_seen_is_an_upper_bound(name: str, bodies: tuple[str, ...]) -> None:
    """Adding a shape can only make a least value over parts smaller."""
    whole = arm(0.05, 0.0)
    for link, x in (("elbow", 0.4), ("wrist", 0.6)):
        whole.box(link, 0.05, (x, 0, 0.25), kind="robot")
    seen = Signals(whole.episode()).get(name, bodies, limits=(0.01,))
    assert seen.known.all()
    whole.bodies[2] = whole.bodies[2].model_copy(update={"geoms": ()})
    less = Signals(whole.episode()).get(name, bodies, limits=(0.01,))
    assert np.isneginf(less.lower).all()
    assert (less.upper >= seen.lower).all()
    assert any("no shape of link" in note for note in less.notes)


def test_only_what_is_missing_is_called_missing() -> None:
    found = Signals(Scene(2).box("vase", 0.05, (0, 0, 0)).episode()).get(
        "clearance", ("robot", "vase")
    )
    assert not found.known.any()
    assert found.notes == ("the trace has no robot",)
