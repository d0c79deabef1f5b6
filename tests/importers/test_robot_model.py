"""Links of robots placed by their joints: analytic poses, names and order of the joints, grippers."""

import numpy as np
import pytest

from safestage_eval.errors import InputError
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.robot_file import load_robot, robot_from_urdf
from safestage_eval.importers.robot_model import match_joints, opening

ARM = """<robot name="two"><link name="world"/>
<link name="base"><collision><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>
<link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/></inertial>
  <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
<link name="hand"><collision><geometry><box size="0.1 0.2 0.02"/></geometry></collision></link>
<link name="left_finger"><collision><geometry><box size="0.02 0.01 0.06"/></geometry></collision></link>
<link name="right_finger"><collision><geometry><box size="0.02 0.01 0.06"/></geometry></collision></link>
<link name="tool"/>
<joint name="fix" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0 0 0.1"/></joint>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/>
  <axis xyz="0 2 0"/><limit lower="-3" upper="3"/></joint>
<joint name="wrist" type="continuous"><parent link="upper"/><child link="hand"/><origin xyz="0 0 0.4" rpy="0 0 0"/>
  <axis xyz="0 0 1"/></joint>
<joint name="left" type="prismatic"><parent link="hand"/><child link="left_finger"/><origin xyz="0 0.01 0.05"/>
  <axis xyz="0 1 0"/><limit lower="0" upper="0.04"/></joint>
<joint name="right" type="prismatic"><parent link="hand"/><child link="right_finger"/><origin xyz="0 -0.01 0.05"/>
  <axis xyz="0 -1 0"/><limit lower="0" upper="0.04"/><mimic joint="left" multiplier="1" offset="0.0"/></joint>
<joint name="t" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0 0 0.1" rpy="3.14159265358979 0 0"/></joint>
</robot>"""

BASE = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])


@pytest.fixture
def robot():
    return robot_from_urdf(ARM, "two.urdf")


def test_links_are_where_trigonometry_says(robot):
    angle = np.array([0.0, np.pi / 2, 0.3])
    poses = robot.place(BASE, {"shoulder": angle, "wrist": np.array([0.0, 0.5, 1.0])})
    tip = poses["tool"][0]
    assert np.allclose(
        tip, np.column_stack([0.5 * np.sin(angle), 0 * angle, 0.2 + 0.5 * np.cos(angle)])
    )
    assert np.allclose(poses["base"][0], [0, 0, 0.1])
    turn = poses["hand"][1][1]
    assert np.allclose(np.abs(turn @ turn), 1)


def test_a_base_that_moves_carries_the_robot(robot):
    at = np.array([[1.0, 0, 0], [0, 2.0, 0]])
    turn = np.tile([np.sqrt(0.5), 0, 0, np.sqrt(0.5)], (2, 1))  # x becomes y
    poses = robot.place((at, turn), {"shoulder": np.full(2, np.pi / 2), "wrist": np.zeros(2)})
    assert np.allclose(poses["hand"][0], at + np.array([0, 0.4, 0.2]))


def test_a_finger_that_follows_another(robot):
    joints = {"shoulder": np.zeros(1), "wrist": np.zeros(1), "left": np.array([0.03])}
    poses = robot.place(BASE, joints)
    assert poses["left_finger"][0][0, 1] == pytest.approx(0.04)
    assert poses["right_finger"][0][0, 1] == pytest.approx(-0.04)
    alone = robot.place(BASE, {**joints, "right": np.array([0.01])})
    assert alone["right_finger"][0][0, 1] == pytest.approx(-0.02)


def test_bodies_have_kinds_shapes_and_sides(robot):
    bodies = {link.body.name: link.body for link in robot.links}
    assert [bodies[n].kind for n in ("base", "upper", "hand", "left_finger")] == ["robot"] * 2 + [
        "gripper"
    ] * 2
    assert (bodies["left_finger"].finger, bodies["right_finger"].finger) == ("left", "right")
    assert bodies["upper"].mass == 2
    assert bodies["upper"].com == (0, 0, 0.2)
    assert not any(body.unseen for body in bodies.values() if body.name in ("world", "tool"))
    assert bodies["hand"].parent == "upper"


@pytest.mark.parametrize(
    "names, count, chosen, found",
    [
        ((), 4, (), ("shoulder", "wrist", "left", "right")),
        ((), 3, (), ("shoulder", "wrist", "left")),
        (("wrist", "shoulder"), 2, (), ("wrist", "shoulder")),
        ((), 2, ("wrist", "shoulder"), ("wrist", "shoulder")),
        ((), 6, (), None),
    ],
)
def test_which_column_is_which_joint(robot, names, count, chosen, found):
    assert match_joints(robot, names, count, chosen) == found


def test_joints_are_numbered_breadth_first():
    text = ARM.replace('name="tool"/>', 'name="tool"/><link name="e"/>', 1).replace(
        "</robot>",
        '<joint name="ear" type="revolute"><parent link="base"/><child link="e"/><axis xyz="0 0 1"/></joint></robot>',
    )
    names = [joint.name for joint in robot_from_urdf(text, "x").layers()]
    assert names == ["shoulder", "ear", "wrist", "left", "right"]


def test_the_gripper_opens_with_its_fingers(robot):
    share = opening(robot, {"left": np.array([0.0, 0.02, 0.04, 0.05])})
    assert np.allclose(share, [0, 0.5, 1, 1])
    turned = ARM.replace('"0 1 0"', '"a"').replace('"0 -1 0"', '"0 1 0"').replace('"a"', '"0 -1 0"')
    turned = robot_from_urdf(
        turned.replace('"0 0.01 0.05"', '"0 0.06 0.05"').replace(
            '"0 -0.01 0.05"', '"0 -0.06 0.05"'
        ),
        "x",
    )
    assert np.allclose(opening(turned, {"left": np.array([0.0, 0.04])}), [1, 0])
    assert opening(robot, {"wrist": np.zeros(2)}) is None


@pytest.mark.parametrize(
    "text, told",
    [
        ("<robot><link name='a'/>", "no URDF"),
        (ARM.replace('<axis xyz="0 2 0"/>', '<axis xyz="0 0 0"/>'), "axis of no length"),
        (
            ARM.replace("revolute", "fixed")
            .replace("continuous", "fixed")
            .replace("prismatic", "fixed"),
            "base",
        ),
        ("<!DOCTYPE x>" + ARM, "entities"),
    ],
)
def test_what_is_no_robot(text, told):
    with pytest.raises(InputError, match=told):
        robot_from_urdf(text, "x.urdf")


def test_files_that_are_none(tmp_path):
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(SourceError, match="no robot description"):
        load_robot(tmp_path / "a.txt")
    with pytest.raises(SourceError, match="cannot be read"):
        load_robot(tmp_path / "none.urdf")


def test_meshes_are_found_beside_it_and_missed_by_name(tmp_path):
    import trimesh

    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "meshes" / "hand.stl")
    mesh = '<geometry><mesh filename="package://two/meshes/hand.stl" scale="0.01 0.01 0.01"/></geometry>'
    text = ARM.replace('<geometry><box size="0.1 0.2 0.02"/></geometry>', mesh)
    (tmp_path / "two.urdf").write_text(text)
    found = load_robot(tmp_path / "two.urdf")
    [hand] = [link.body for link in found.links if link.body.name == "hand"]
    vertices = found.meshes[hand.geoms[0].mesh].vertices
    assert np.allclose(np.abs(vertices), 0.01)
    lost = robot_from_urdf(text, "x", (tmp_path / "elsewhere",))
    assert lost.lost == ("package://two/meshes/hand.stl",)
    assert next(link.body for link in lost.links if link.body.name == "hand").unseen
