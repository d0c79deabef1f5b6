"""Parts on hinges: a drawer stays in its place, a jar's lid goes where the jar goes."""

import numpy as np
import pytest
from scenes import G, Scene
from told import holds

from safestage_eval.episode import still_track
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge


def relations(scene: Scene, **header: str) -> Relations:
    return Relations(Signals(scene.episode(**header)))


def jar(frames: int = 3, drop: float = 0.0) -> Scene:
    """A jar on a table, its lid on a hinge (no contact shows it), a cup on the lid; 1 kg each."""
    z = -drop * np.linspace(0, 1, frames)[:, None] * [0, 0, 1]
    scene = Scene(frames).fixed("table")
    scene.box("jar", 0.05, z + np.array((0, 0, 0.05)))
    scene.box("lid", (0.05, 0.05, 0.005), z + np.array((0, 0, 0.105)), parent="jar")
    return scene.box("cup", 0.03, z + np.array((0, 0, 0.14)))


def standing(scene: Scene) -> Scene:
    scene.rests("jar", "table", 0.05, (0, 0, 0), 3 * G)
    return scene.rests("cup", "lid", 0.03, (0, 0, 0.11), G)


@pytest.mark.parametrize("forces", ["recorded", "none"])
def test_a_lid_is_supported_as_its_jar_is(forces: str) -> None:
    found = relations(standing(jar()), force_source=forces)
    for body in ("jar", "lid", "cup"):
        assert holds(found, "supported", (body,)).all(), body
    scene = jar().rests("cup", "lid", 0.03, (0, 0, 0.11), G)
    scene.tracks["table"] = still_track((0, 0, -1), (1, 0, 0, 0))
    floating = relations(scene, force_source=forces)
    for body in ("jar", "lid", "cup"):
        assert not holds(floating, "supported", (body,)).any(), body


def test_a_jar_that_falls_off_is_dropped_with_its_lid() -> None:
    scene = jar(frames=60, drop=0.3).rests("cup", "lid", 0.03, (0, 0, 0.11), G)
    for y, side in ((-0.02, "left"), (0.02, "right")):  # a hand that pushed it off
        scene.box(side, 0.02, (0.07, y, 0.05), kind="gripper", finger=side)
        scene.contact(side, "jar", (0.05, y, 0.05), (-1, 0, 0), (-1, 0, 0), slice(0, 3))
    for body in ("jar", "lid", "cup"):
        found = judge(
            scene.episode(roles={"protected": [body]}, success=True, success_time=0.4),
            load_rules(["ets"]),
        )
        assert {v.rule: v.verdict for v in found.verdicts}["ETS103"] == "violation", body


def test_lifted_by_its_lid_the_jar_is_carried() -> None:
    scene = jar(2)
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, (-0.06 * sign, 0, 0.105), kind="gripper", finger=side)
        scene.contact(
            side, "lid", (-0.05 * sign, 0, 0.105), (30 * sign, 0, 1.5 * G), normal=(sign, 0, 0)
        )
    scene.rests("cup", "lid", 0.03, (0, 0, 0.11), G)
    found = relations(scene)
    assert holds(found, "held", ("lid",)).all()
    assert not holds(found, "held", ("jar",)).any()
    assert holds(found, "carried", ("jar",)).all()
    assert holds(found, "carried", ("cup",)).all()
    assert not holds(found, "depends_on", ("cup", "table")).any()


@pytest.mark.parametrize(
    ("parent", "kind", "stays"),
    [
        ("cabinet", "object", True),  # a drawer, whatever it is called
        ("world", "object", True),  # what the trace does not list is no free body
        (None, "fixture", True),
        ("drawer", "object", True),  # a box on a hinge in a drawer
        (None, "object", False),
        ("jar", "object", False),
        ("jar", "fixture", False),
        ("link", "object", False),
    ],
)
def test_a_part_stays_where_its_chain_of_joints_ends_at_the_world(
    parent: str | None, kind: str, stays: bool
) -> None:
    scene = Scene(2).fixed("cabinet").box("jar", 0.05, (1, 0, 0)).box("link", 0.05, (2, 0, 0),
                                                                      kind="robot")  # fmt: skip
    scene.box("drawer", 0.05, (0, 0, 1), kind="fixture", parent="cabinet")
    scene.box("part", 0.05, (0, 0, 2), kind=kind, parent=parent)
    scene.box("load", 0.05, (0, 0, 2.1)).rests("load", "part", 0.05, (0, 0, 2.05), G)
    found = relations(scene)
    assert holds(found, "supported", ("load",)).all() == stays
