"""The margin to an edge, of whatever bears a body or of one support that is named."""

from typing import Any

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations


def margin(scene: Scene, *bodies: str) -> float:
    found = Relations(Signals(scene.episode())).signal("edge_margin", bodies)
    (value,) = {*found.lower.tolist(), *found.upper.tolist()}
    return value


def standing(*names: str) -> Scene:
    """A box, half 5 cm, at x = 3 cm on one block or two, half 10 cm, that meet at x = 0."""
    scene = Scene(2).fixed("table")
    for name, x in zip(names, (0.1, -0.1), strict=False):
        scene.box(name, 0.1, (x, 0, 0.1)).rests(name, "table", 0.1, (x, 0, 0), 2 * G)
    scene.box("box", 0.05, (0.03, 0, 0.25))
    for name in names:
        scene.rests("box", name, 0.02, (0.02, 0, 0.2), G / len(names))
    return scene


def test_of_the_one_that_bears_it_both_ways_to_ask_agree() -> None:
    """The base reaches 2 cm beyond the block's edge."""
    scene = standing("right")
    assert margin(scene, "box") == pytest.approx(-0.02, abs=1e-4)
    assert margin(scene, "box", "right") == margin(scene, "box")


def test_of_two_that_bear_it_each_has_its_own_edge_and_both_together_one() -> None:
    scene = standing("right", "left")
    assert margin(scene, "box", "right") == pytest.approx(-0.02, abs=1e-4)
    assert margin(scene, "box", "left") == pytest.approx(-0.08, abs=1e-4)
    assert margin(scene, "box") == pytest.approx(0.05, abs=1e-4)  # to the blocks' sides


def test_at_each_frame_what_bears_it_then_counts() -> None:
    """The right block bears it throughout, the left one, 1 cm away, at the first frame."""
    scene = (
        standing("right")
        .box("left", 0.1, (-0.11, 0, 0.1))
        .rests("left", "table", 0.1, (-0.11, 0, 0), G)
    )
    scene.rests("box", "left", 0.005, (-0.015, 0, 0.2), G / 2, frames=slice(0, 1))
    found = Relations(Signals(scene.episode())).signal("edge_margin", ("box",))
    assert np.allclose(found.value, [0.05, -0.02], atol=1e-4)


def beside(left: Any = (-0.1, 0, 0.1), **fields: Any) -> Scene:
    """Stand it on one block, beside another that does not bear it."""
    return standing("right").box("left", 0.1, left, **fields)


def test_what_stands_beside_the_bearer_is_part_of_the_surface() -> None:
    scene = beside()
    assert margin(scene, "box") == pytest.approx(0.05, abs=1e-4)
    assert margin(scene, "box", "right") == pytest.approx(-0.02, abs=1e-4)


def inside(**rail: Any) -> Scene:
    """A box, half 5 cm, 1 cm from the right block's left edge, where a rail stands."""
    scene = standing("right")
    scene.tracks["box"].position[:, 0] = 0.06
    return scene.box("rail", (0.005, 0.1, 0.15), (-0.005, 0, 0.15), **rail)


def test_a_rail_of_another_body_guards() -> None:
    assert margin(inside(), "box") == pytest.approx(0.05, abs=1e-4)
    assert margin(inside(), "box", "right") == pytest.approx(0.01, abs=1e-4)
    assert margin(inside(kind="gripper"), "box") == pytest.approx(0.01, abs=1e-4)


def test_where_the_pose_of_a_neighbour_is_not_known_an_edge_is_at_least_so_far() -> None:
    scene = beside()
    scene.tracks["left"].position[1] = np.nan
    found = Relations(Signals(scene.episode())).signal("edge_margin", ("box",))
    assert np.allclose(found.lower, [0.05, -0.02], atol=1e-4)
    assert found.upper[0] == pytest.approx(0.05, abs=1e-4)
    assert found.upper[1] == np.inf
