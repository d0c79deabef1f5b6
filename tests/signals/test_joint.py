"""Joints of the robot and of fixtures, the gripper's own, and the robot's distance to itself."""

import numpy as np
import pytest
from scenes import Scene
from transforms import rebuilt

from safestage_eval.episode import Episode, Geom, Joint, RobotFrames
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals

T = np.arange(41) / 100
JOINTS = (
    Joint(name="elbow", kind="revolute", body="arm", limits=(-2.0, 2.5)),
    Joint(name="slide", kind="prismatic", body="drawer", limits=(0.0, 0.4)),
    Joint(name="hinge", kind="revolute", body="door", limits=(-1.6, 0.0)),
    Joint(name="knob", kind="revolute", body="stove"),
    Joint(name="hob", kind="revolute", body="stove", limits=(0.0, 0.0)),
)


def kitchen(**missing: np.ndarray) -> Episode:
    """Every joint moves as sin t from 0, at a rate and with a torque that tell them apart."""
    scene = Scene(len(T), 100.0).fixed("table")
    scene.box("arm", 0.05, (0, 0, 1), kind="robot")
    for name in ("drawer", "door", "stove"):
        scene.box(name, 0.05, (1, 0, 1), kind="fixture")
    scene.box("cup", 0.05, (2, 0, 1))
    rate = np.array([1, 0.4, -1.6, 2, 3])
    position = np.sin(T)[:, None] * rate
    columns = {
        "joint_position": position,
        "joint_velocity": np.cos(T)[:, None] * rate,
        "joint_torque": -position,
        "action": np.zeros((len(T), 0)),
        "gripper": np.zeros((len(T), 0)),
        **missing,
    }
    frames = RobotFrames(**{name: np.float32(column) for name, column in columns.items()})
    return rebuilt(scene.episode(joints=JOINTS), frames=frames)


def get(name: str, joint: str, episode: Episode | None = None, unit: str = "") -> Interval:
    options = (("unit", unit),) if unit else ()
    return Signals(episode or kitchen()).get(name, [joint], options=options)


def test_speed_and_torque_keep_their_signs() -> None:
    assert np.allclose(get("joint_speed", "elbow").value, np.cos(T), atol=1e-6)
    assert np.allclose(get("joint_torque", "elbow").value, -np.sin(T), atol=1e-6)
    assert (get("joint_speed", "hinge").value < 0).all()


def test_opening_is_0_where_models_put_what_is_shut() -> None:
    assert np.allclose(get("joint_opening", "slide").value, np.sin(T), atol=1e-6)
    assert np.allclose(get("joint_opening", "hinge").value, np.sin(T), atol=1e-6)
    assert np.allclose(get("joint_opening", "elbow").value, (np.sin(T) + 2) / 4.5, atol=1e-6)


def test_a_body_stands_for_its_only_joint() -> None:
    for name in ("joint_opening", "joint_speed"):
        assert np.array_equal(get(name, "door").value, get(name, "hinge").value)
    assert "cup has no joint" in get("joint_opening", "cup").notes
    assert "stove has several joints: knob, hob" in get("joint_opening", "stove").notes


@pytest.mark.parametrize(
    ("name", "unit", "dimension"), [("joint_speed", "m/s", "speed"), ("joint_torque", "N", "force")]
)
def test_what_slides_is_not_measured_as_if_it_turned(name: str, unit: str, dimension: str) -> None:
    sliding, turning = get(name, "slide"), get(name, "elbow", unit=unit)
    assert not sliding.known.any()
    assert "slide slides" in sliding.notes[0]
    assert not turning.known.any()
    assert "elbow turns" in turning.notes[0]
    series = get(name, "slide", unit=unit)
    assert series.known.all()
    assert series.dimension == dimension


def test_what_was_not_recorded() -> None:
    none = np.zeros((len(T), 0))
    derived = get("joint_speed", "elbow", kitchen(joint_velocity=none))
    assert np.allclose(derived.value, np.cos(T), atol=6e-3)
    assert np.allclose(derived.value[1:-1], np.cos(T)[1:-1], atol=3e-5)
    assert "derived from its positions" in derived.notes[0]
    bare = kitchen(joint_position=none, joint_velocity=none, joint_torque=none)
    for name in ("joint_speed", "joint_torque", "joint_opening"):
        found = get(name, "elbow", bare)
        assert not found.known.any()
        assert found.notes
    assert not get("joint_opening", "knob").known.any()
    assert not get("joint_opening", "hob").known.any()


BALL = Geom(kind="sphere", size=(0.1,))


def robot(*more: dict, **header) -> Scene:
    """A base, an arm on it, a hand whose ball comes from 1 m to 0.3 m of the base's centre."""
    x = np.linspace(1.0, 0.3, 8)
    path = np.column_stack([x, 0 * x, 0 * x])
    scene = Scene(8).fixed("base", kind="robot", geoms=(BALL,))
    scene.body("arm", BALL, (0.15, 0, 0), kind="robot", parent="base")
    scene.body("hand", BALL, path, kind="gripper", parent="arm", excluded=("wrist",))
    return scene.body("wrist", BALL, path, kind="robot", parent="base")


def test_self_clearance_leaves_out_neighbours_and_what_the_model_excludes() -> None:
    """Only hand–base (0.1 m at the end) and arm–wrist (touching) may collide."""
    found = Signals(robot().episode()).get("self_clearance", reach=1.0).value
    x = np.linspace(1.0, 0.3, 8)
    assert np.allclose(found[:7], (np.abs(x - 0.15) - 0.2)[:7], atol=1e-6)
    scene = robot()
    scene.bodies = [
        b.model_copy(update={"excluded": ("arm",)}) if b.name == "wrist" else b
        for b in scene.bodies
    ]
    found = Signals(scene.episode()).get("self_clearance", reach=1.0).value
    assert np.allclose(found, x - 0.2, atol=1e-6)
