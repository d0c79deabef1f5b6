"""ManiSkill's layout."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from exports import com_twist, map_text, write_maniskill
from scenes import Scene
from studio import run
from told import holds, why_unknown

from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import load
from safestage_eval.relations.relations import Relations


def scene(**header):
    s = Scene(30, 20.0).fixed("table-workspace").box("goal_site", 0.02, (0.3, 0, 0.02))
    s.box("cube", 0.02, np.linspace((0, 0, 0.02), (0.3, 0, 0.02), 30), com=(0.01, 0, 0))
    s.tracks["cube"].angular_velocity[:, 2] = 1.5
    fields = {"success": True, "success_time": 1.0, "task": "PushCube-v1", **header}
    return s.episode(**fields)


@pytest.fixture
def source(tmp_path):
    (tmp_path / "map.toml").write_text(map_text(scene()))
    return write_maniskill(tmp_path / "in", scene())


def take(source, to, *more):
    return run("import", source, "--to", to, "--map", to.parent / "map.toml", *more)


def test_what_is_read(source, tmp_path):
    done = take(source, tmp_path / "data")
    assert done.code == 0, done.err
    theirs, ours = load(tmp_path / "data", "trajectory/traj_0"), scene()
    assert np.allclose(theirs.t, ours.t)
    for name in ("position", "angular_velocity"):
        assert np.array_equal(
            getattr(theirs.track("cube"), name), getattr(ours.track("cube"), name)
        )
    a, b = theirs.track("cube"), ours.track("cube")
    assert np.allclose(a.linear_velocity, b.linear_velocity, atol=1e-6)
    recorded = com_twist(ours, ours.bodies["cube"])[:, :3]
    assert not np.allclose(recorded, b.linear_velocity, atol=1e-3)  # it was moved to the origin
    header = theirs.header
    assert (header.task, header.seed, header.success) == ("PushCube-v1", 4, True)
    assert header.success_time == pytest.approx(1.0)
    assert header.post_success_hold == pytest.approx(0.45)
    assert header.physics_dt == pytest.approx(1 / 20)
    assert theirs.frames.joint_position.shape == (30, 9)
    assert not theirs.bodies["table-workspace"].movable
    assert theirs.bodies["robot_base" if "robot_base" in theirs.bodies else "panda"].untold == (
        "links",
    )
    text = done.text
    for what in ("poses of the links of panda", "the time after success", "contacts"):
        assert what in text


def without(source, part):
    with h5py.File(source, "a") as file:
        if part == "flat":
            del file["traj_0/env_states"]
            file["traj_0/env_states"] = np.zeros((30, 44), np.float32)
        else:
            del file[part]


@pytest.mark.parametrize(
    ("part", "told"),
    [
        ("traj_0/env_states", ("objects were not recorded", "--use-env-states")),
        ("flat", ("one flat array", "--use-env-states")),
        ("traj_0/env_states/actors", ("has no actors", "--use-env-states")),
    ],
)
def test_states_that_are_missing(source, tmp_path, part, told):
    without(source, part)
    done = take(source, tmp_path / "data")
    assert done.code == 2
    for text in told:
        assert text in done.err


RECORDED = Path(__file__).parent / "foreign" / "maniskill" / "stack_cube.h5"
SCENE = """
[every]
roles = { target = "cubeA", destination = "cubeB" }

[body."cube*"]
mass = 0.064
up = false
cavity = false
com = [0, 0, 0]
shapes = [{ kind = "box", size = [0.02, 0.02, 0.02] }]

[body.table-workspace]
shapes = [{ kind = "box", size = [1.2, 0.6, 0.4598], position = [0, 0, 0.4598] }]
"""


def test_an_episode_of_maniskills_own_recorder(tmp_path):
    """Recorded by ManiSkill 3.0.1: the arm waves about over two cubes that lie on a table."""
    (tmp_path / "map.toml").write_text(SCENE)
    refused = take(RECORDED, tmp_path / "data")
    assert "--dt 1/20" in refused.err
    done = take(RECORDED, tmp_path / "data", "--dt", "1/20")
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data", "stack_cube/traj_0")
    with h5py.File(RECORDED) as file:
        for name in ("cubeA", "cubeB"):
            rows = file[f"traj_0/env_states/actors/{name}"][()]
            track = theirs.track(name)
            assert np.array_equal(track.position, rows[:, :3])
            assert np.allclose(track.orientation, rows[:, 3:7], atol=1e-6)
            assert np.array_equal(track.linear_velocity, rows[:, 7:10])
            assert np.array_equal(track.angular_velocity, rows[:, 10:])
        joints = file["traj_0/env_states/articulations/panda_wristcam"][()]
    assert np.array_equal(theirs.frames.joint_position, joints[:, 13:22])
    assert (len(theirs), theirs.header.task, theirs.header.success) == (31, "StackCube-v1", False)
    relations = Relations(Signals(theirs))
    assert holds(relations, "supports", ("table-workspace", "cubeA")).all()
    assert holds(relations, "supported", ("cubeB",)).all()
    assert why_unknown(relations, "held", ("cubeA",))  # the hand was not recorded
    scored = run("score", tmp_path / "data", "--rules", "fsh", "--format", "json")
    verdicts = {row["rule"]: row["verdict"] for row in json.loads(scored.text)["episodes"]}
    assert verdicts["FSH101"] == "pass"  # never moved: nothing was put down
    assert verdicts["FSH105"] == "pass"  # lost no height, whoever may have held it
