"""Arms whose recording has their joints alone, placed by a description, in each format that has joints."""

import numpy as np
import pytest
from exports import map_text, write_lerobot, write_maniskill
from scenes import Scene
from studio import run

from safestage_eval.formats import load
from safestage_eval.importers.robot_file import load_robot


def chain(count):
    """A URDF of links on top of each other, the last two of them fingers."""
    parts, box = [], '<collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision>'
    names = [f"link{i}" for i in range(count - 1)] + ["hand_left_finger", "hand_right_finger"]
    for i, name in enumerate(names):
        parts.append(f'<link name="{name}">{box}</link>')
        if i:
            parent, kind = (
                (names[i - 1], "revolute") if i < count - 1 else (names[count - 2], "prismatic")
            )
            axis = f"0 {(-1) ** i} 0"
            parts.append(
                f'<joint name="j{i}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
                f'<origin xyz="0 0 0.1"/><axis xyz="{axis}"/><limit lower="-1" upper="1"/></joint>'
            )
    return f'<robot name="chain">{"".join(parts)}</robot>'


def scene(joints):
    s = Scene(30, 20.0).fixed("table").box("cube", 0.02, (0.4, 0, 0.02))
    return s.episode(), np.outer(np.sin(s.t), np.linspace(0.1, 0.9, joints))


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "chain.urdf"
    path.write_text(chain(9))
    return path


def placed_as(theirs, robot, base, columns):
    """Every link is where the description and the joints have it."""
    model = load_robot(robot)
    track = theirs.track(base)
    poses = model.place(
        (track.position.astype(float), track.orientation.astype(float)),
        {joint.name: columns[:, i] for i, joint in enumerate(model.joints)},
    )
    assert len(poses) == 10
    for name, (place, turn) in poses.items():
        mine = theirs.track(base if name == "link0" else name)
        assert np.abs(mine.position - place).max() < 1e-6
        assert np.abs(np.abs((mine.orientation * turn).sum(1)) - 1).max() < 1e-6
    assert [joint.name for joint in theirs.header.joints] == [joint.name for joint in model.joints]
    assert theirs.bodies["hand_left_finger"].finger == "left"
    assert not any("links" in body.untold for body in theirs.header.bodies)


def test_maniskill(tmp_path, robot):
    import h5py

    episode, columns = scene(9)
    source = write_maniskill(tmp_path / "in", episode)
    with h5py.File(source, "a") as file:
        arms = file["traj_0/env_states/articulations"]
        [name] = arms
        rows = arms[name][()]
        rows[:, 13:22] = columns
        arms[name][...] = rows
        columns = arms[name][:, 13:22].astype(float)
    (tmp_path / "map.toml").write_text(map_text(episode))
    done = run(
        "import",
        source,
        "--to",
        tmp_path / "data",
        "--map",
        tmp_path / "map.toml",
        "--robot",
        robot,
    )
    assert done.code == 0, done.err
    assert "from its joints, by chain.urdf" in done.text
    base = next(
        body.name
        for body in load(tmp_path / "data").header.bodies
        if "panda" in body.name or body.name == "robot_base"
    )
    placed_as(load(tmp_path / "data"), robot, base, columns)
    assert load(tmp_path / "data").frames.gripper.shape == (30, 1)


@pytest.mark.parametrize("placed", [True, False])
def test_lerobot(tmp_path, robot, placed):
    import json

    import pyarrow as pa
    import pyarrow.parquet as pq

    episode, columns = scene(9)
    columns = columns.astype(np.float32)
    source, text = write_lerobot(tmp_path / "in", [episode])
    [file] = source.glob("data/*/*.parquet")
    pq.write_table(
        pq.read_table(file).append_column("observation.state", pa.array(list(columns))), file
    )
    info = json.loads((source / "meta/info.json").read_text())
    info["features"]["observation.state"] = {
        "dtype": "float32",
        "shape": [9],
        "names": [f"j{i}.pos" for i in range(1, 10)],
    }
    (source / "meta/info.json").write_text(json.dumps(info))
    text = text.replace(
        "[source]", '[columns]\njoint_position = "observation.state"\n[source]'
    ) + map_text(episode)
    if placed:
        text += "[body.robot_base]\nposition = [0.1, 0.2, 0.3]\n"
    (tmp_path / "map.toml").write_text(text)
    done = run(
        "import",
        source,
        "--to",
        tmp_path / "data",
        "--map",
        tmp_path / "map.toml",
        "--robot",
        robot,
    )
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data")
    assert np.allclose(theirs.track("robot_base").position[0], [0.1, 0.2, 0.3] if placed else 0)
    assert ("place of the robot's base" in done.text) != placed
    assert "order of the joints" not in done.text  # they are named
    placed_as(theirs, robot, "robot_base", columns.astype(float))
