"""Robots placed by their joints are where MuJoCo has them."""

import mujoco
import numpy as np
import pytest

from safestage_eval.errors import InputError
from safestage_eval.importers.robot_file import load_robot, robot_from_urdf
from simulate.arm import droid

pytestmark = pytest.mark.simulate


def random_urdf(rng, count=9):
    """A tree of links with every kind of joint, at any place and turn."""

    def text(values):
        return " ".join(f"{v:.12g}" for v in values)

    parts = [
        '<link name="l0"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    ]
    for i in range(1, count):
        kind = ("revolute", "continuous", "prismatic", "fixed")[rng.integers(4) if i > 1 else 0]
        parts.append(parts[0].replace("l0", f"l{i}"))
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="l{rng.integers(max(0, i - 3), i)}"/><child link="l{i}"/>'
            f'<origin xyz="{text(rng.normal(size=3))}" rpy="{text(rng.uniform(-3, 3, 3))}"/>'
            f'<axis xyz="{text(rng.normal(size=3))}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    head = '<robot name="r"><mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    return head + "".join(parts) + "</robot>"


@pytest.mark.parametrize("seed", range(6))
def test_a_urdf_is_where_mujoco_has_it(seed):
    rng = np.random.default_rng(seed)
    text = random_urdf(rng)
    model = mujoco.MjModel.from_xml_string(text)
    compare(robot_from_urdf(text, "r.urdf"), model, rng)


MJCF = """<mujoco><compiler angle="degree" eulerseq="zyx"/><default><joint damping="1"/><geom size=".05"/></default>
<worldbody><body name="table" pos="1 0 0"><geom type="box" size=".1 .1 .1"/></body>
<body name="base" pos="0.3 0.1 0.2" euler="10 20 30"><geom type="sphere"/>
  <body name="a" pos="0 0 .1" quat="1 1 0 0"><joint name="a1" axis="0 1 1" pos=".1 .02 0" ref="20"/>
    <joint name="a2" type="slide" axis="1 0 0"/><joint name="a3" axis="1 0 0" pos="0 .1 0"/><geom type="sphere"/>
    <body name="gripper_left_finger" pos=".1 0 0" axisangle="0 1 0 40"><joint name="l" type="slide" range="0 .04" axis="0 1 0"/><geom type="sphere"/></body>
    <body name="gripper_right_finger" pos="-.1 0 0"><joint name="r" type="slide" range="0 .04" axis="0 -1 0"/><geom type="sphere"/></body>
  </body></body></worldbody>
<actuator><motor joint="a1"/></actuator>
<equality><joint joint1="r" joint2="l"/></equality></mujoco>"""


def test_mjcf_with_several_joints_at_a_body(tmp_path):
    path = tmp_path / "r.xml"
    path.write_text(MJCF)
    robot = load_robot(path)
    model = mujoco.MjModel.from_xml_string(MJCF)
    compare(robot, model, np.random.default_rng(1))
    assert [joint.name for joint in robot.driven] == ["a1", "a2", "a3", "l"]
    bodies = {link.body.name: link.body for link in robot.links}
    assert "table" not in bodies
    assert bodies["gripper_left_finger"].kind == "gripper"
    assert bodies["a"].kind == "robot"


@pytest.mark.parametrize("included", [False, True])
def test_a_nested_model_without_a_file_is_refused_before_mujoco_hangs(tmp_path, included):
    """MuJoCo tells it as an unknown exception, and never ends the next model that it is asked to read."""
    bad, path = (
        MJCF.replace("<worldbody>", "<asset><model/></asset><worldbody>"),
        tmp_path / "r.xml",
    )
    path.write_text(
        MJCF.replace("<worldbody>", '<include file="o.xml"/><worldbody>') if included else bad
    )
    (tmp_path / "o.xml").write_text("<mujoco><asset><model/></asset></mujoco>")
    with pytest.raises(InputError, match=r"r\.xml: a <model> in its <asset> names no file"):
        load_robot(path)


def test_our_own_arm():
    path = droid.default_mjcf()
    compare(load_robot(path), mujoco.MjModel.from_xml_path(str(path)), np.random.default_rng(2))


def compare(robot, model, rng, frames=20):
    """All links within 1e-6 m and 1e-6 rad of MuJoCo's, at random joint positions."""
    data = mujoco.MjData(model)
    columns = {joint.name: rng.uniform(-1, 1, frames) for joint in robot.joints}
    first = robot.links[0].body.name
    base = (
        model.body(first).id if any(model.body(i).name == first for i in range(model.nbody)) else 0
    )
    mujoco.mj_kinematics(model, data)
    poses = robot.place((data.xpos[base][None], data.xquat[base][None]), columns)
    seen = 0
    for t in range(frames):
        for name, values in columns.items():
            data.joint(name).qpos[0] = values[t]
        mujoco.mj_kinematics(model, data)
        for name, (place, turn) in poses.items():
            i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if i < 0:
                continue
            assert np.abs(data.xpos[i] - np.broadcast_to(place, (frames, 3))[t]).max() < 1e-6, name
            assert (
                2
                * np.arccos(
                    min(1, abs(float(data.xquat[i] @ np.broadcast_to(turn, (frames, 4))[t])))
                )
                < 1e-6
            ), name
            seen += 1
    assert seen >= frames * 3
