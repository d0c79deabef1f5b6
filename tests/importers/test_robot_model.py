"""Links of robots placed by their joints: analytic poses, names and order of the joints, grippers."""

import numpy as np
import pytest

from safestage_eval.errors import InputError
from safestage_eval.importers.robot_file import load_robot, robot_from_urdf
from safestage_eval.importers.robot_model import match_joints

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


def test_a_finger_that_follows_another(robot):
    joints = {"shoulder": np.zeros(1), "wrist": np.zeros(1), "left": np.array([0.03])}
    poses = robot.place(BASE, joints)
    assert poses["left_finger"][0][0, 1] == pytest.approx(0.04)
    assert poses["right_finger"][0][0, 1] == pytest.approx(-0.04)
    alone = robot.place(BASE, {**joints, "right": np.array([0.01])})
    assert alone["right_finger"][0][0, 1] == pytest.approx(-0.02)


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
