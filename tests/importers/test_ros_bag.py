"""SQLite bags give what MCAP bags give, message by message; joint states place what no transform does."""

import sqlite3
from time import process_time

import numpy as np
import pytest
from bags import TF_MESSAGE, as_sqlite, ros_transform
from mcap_ros2.writer import Writer as RosWriter
from studio import run
from test_robot_model import ARM
from test_transforms import tumbling, write_bag

from safestage_eval.formats import load
from safestage_eval.importers.bag_files import messages, topics
from safestage_eval.importers.robot_file import robot_from_urdf

JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    + TF_MESSAGE[TF_MESSAGE.index("=" * 80) :]
)


def with_map(folder, text=""):
    (folder / "map.toml").write_text(
        '[body.cube]\nshapes = [{ kind = "box", size = [0.02, 0.02, 0.02] }]\n'
        '[body.ball]\nshapes = [{ kind = "sphere", size = [0.02] }]\n' + text
    )


@pytest.mark.parametrize("folder", [True, False])
def test_it_is_read_as_its_mcap_twin(tmp_path, folder):
    with_map(tmp_path)
    mcap = write_bag(tmp_path / "run.mcap", tumbling())
    (tmp_path / "bag").mkdir()
    sqlite = as_sqlite(mcap, tmp_path / "bag" / "run_0.db3")
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    assert "tf2_msgs/msg/TFMessage" in topics(sqlite).values()
    found = []
    for source in (mcap, tmp_path / "bag" if folder else sqlite):
        to = tmp_path / f"data{len(found)}"
        done = run("import", source, "--to", to, "--map", tmp_path / "map.toml")
        assert done.code == 0, done.err
        found.append(load(to))
    one, other = found
    assert np.array_equal(one.t, other.t)
    for name, track in one.tracks.items():
        assert np.array_equal(track.position, other.tracks[name].position)
        assert np.array_equal(track.orientation, other.tracks[name].orientation)


def test_damaged_and_foreign_databases(tmp_path):
    with_map(tmp_path)
    mcap = write_bag(tmp_path / "run.mcap", tumbling())
    lost = as_sqlite(mcap, tmp_path / "lost.db3", leave_out=("/tf_static",))
    whole = as_sqlite(mcap, tmp_path / "whole.db3").read_bytes()
    with sqlite3.connect(tmp_path / "other.db3") as other:
        other.execute("CREATE TABLE notes(text TEXT)")
    other.close()
    (tmp_path / "cut.db3").write_bytes(whole[: len(whole) // 2])
    for name in ("other", "cut"):
        done = run(
            "import",
            tmp_path / f"{name}.db3",
            "--to",
            tmp_path / "d",
            "--map",
            tmp_path / "map.toml",
        )
        assert done.code == 2, name
        assert "bug" not in done.err
    if b"/tf_static" in whole:
        done = run("import", lost, "--to", tmp_path / "d", "--map", tmp_path / "map.toml")
        assert "does not list" in done.err


TOPICS = "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT);"
LISTED = f"{TOPICS} INSERT INTO topics VALUES (1, '/tf', 'tf2_msgs/msg/TFMessage', 'cdr');"
ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS id"
PROGRAMS = {
    "a view without end for topics": (
        f"CREATE VIEW topics AS {ENDLESS}, '' AS name, '' AS type, '' AS serialization_format FROM n;"
        "CREATE TABLE messages(id, topic_id, timestamp, data);",
        "'topics' is no plain table",
    ),
    "a view without end for messages": (
        f"{LISTED} CREATE VIEW messages AS {ENDLESS}, 1 AS topic_id, x AS timestamp, x AS data FROM n;",
        "'messages' is no plain table",
    ),
    "computed data": (
        f"{LISTED} CREATE TABLE messages(id, topic_id, timestamp, data AS (zeroblob(900000000)));"
        "INSERT INTO messages VALUES (1, 1, 1);",
        "'messages' is no plain table",
    ),
    "a virtual table": (
        f"{LISTED} CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, timestamp, data);",
        "'messages' is no plain table",
    ),
    "no messages": (LISTED, "no table 'messages'"),
    "a number for data": (
        f"{LISTED} CREATE TABLE messages(id, topic_id, timestamp, data);"
        "INSERT INTO messages VALUES (1, 1, 1, 900000000);",
        "whose data are no bytes",
    ),
    "a text for a time": (
        f"{LISTED} CREATE TABLE messages(id, topic_id, timestamp, data);"
        "INSERT INTO messages VALUES (1, 1, '1', x'00');",
        "whose time is no integer",
    ),
    "nothing for a time": (
        f"{LISTED} CREATE TABLE messages(id, topic_id, timestamp, data);"
        "INSERT INTO messages VALUES (1, 1, NULL, x'00');",
        "whose time is no integer",
    ),
}
"""Strangers' databases with views, programs or other values instead of tables are refused in words."""


def written(path, script):
    with sqlite3.connect(path) as made:
        made.executescript(script)
    made.close()
    return path


@pytest.mark.parametrize("what", PROGRAMS)
def test_nothing_in_a_database_is_run(tmp_path, what):
    script, message = PROGRAMS[what]
    path = written(tmp_path / "bag.db3", script)
    began = process_time()
    assert {*topics(path).values()} <= {"tf2_msgs/msg/TFMessage"}
    with pytest.raises(ValueError, match=message):
        list(messages(path))
    assert process_time() - began < 1


def test_a_database_comes_back_when_its_time_is_over(tmp_path, monkeypatch):
    rows = "INSERT INTO messages SELECT x, 1, x, x'00' FROM n;"
    path = written(
        tmp_path / "bag.db3",
        f"{LISTED} CREATE TABLE messages(id, topic_id, timestamp, data);"
        "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n WHERE x < 300000) " + rows,
    )
    assert sum(1 for _ in messages(path)) == 300_000
    monkeypatch.setenv("SAFESTAGE_LIMITS", "seconds=0")
    with pytest.raises(ValueError, match="takes longer"):
        list(messages(path))


@pytest.mark.parametrize("named", ["in the bag", "by --robot"])
def test_joint_states_place_an_arm(tmp_path, named):
    with_map(tmp_path)
    model, frames = robot_from_urdf(ARM, "two.urdf"), 40
    t = np.arange(frames) / 20
    shoulder, left = 0.8 * np.sin(t), 0.02 + 0.02 * np.cos(t)
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = RosWriter(stream)
        tf = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
        state = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        text = writer.register_msgdef("std_msgs/msg/String", "string data")
        if named == "in the bag":
            writer.write_message("/robot_description", text, {"data": ARM}, 0, 0)
        for i in range(frames):
            now = 10**12 + round(t[i] * 1e9)
            cube = ros_transform(now, "world", "cube", (0.5, 0.01 * i, 0.02), (1, 0, 0, 0))
            writer.write_message("/tf", tf, {"transforms": [cube]}, now, now)
            message = {
                "header": {"stamp": {"sec": now // 10**9, "nanosec": now % 10**9}, "frame_id": ""},
                "name": ["left", "shoulder"], "position": [left[i], shoulder[i]], "velocity": [], "effort": [],
            }  # fmt: skip
            writer.write_message("/joint_states", state, message, now, now)
        writer.finish()
    (tmp_path / "two.urdf").write_text(ARM)
    more = ["--robot", tmp_path / "two.urdf"] if named == "by --robot" else []
    bag = as_sqlite(tmp_path / "run.mcap", tmp_path / "run.db3")
    done = run("import", bag, "--to", tmp_path / "data", "--map", tmp_path / "map.toml", *more)
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data")
    base = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
    for name, (place, _) in model.place(base, {"shoulder": shoulder, "left": left}).items():
        assert np.abs(theirs.track(name).position - place).max() < 1e-6, name
    assert theirs.bodies["left_finger"].finger == "left"
    assert np.allclose(theirs.frames.gripper[:, 0], left / 0.04, atol=1e-6)
    assert [joint.name for joint in theirs.header.joints] == ["left", "shoulder"]


def test_a_ros_1_bag(tmp_path):
    """The transforms of a ROS 2 bag, written as ROS 1 has them, come to the same poses."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    with_map(tmp_path)
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    kinds = store.types
    place, turn = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    with Writer(tmp_path / "run.bag") as bag:
        tf = bag.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=store)
        for i in range(20):
            now = 10**12 + 50_000_000 * i
            header = kinds["std_msgs/msg/Header"](
                i, kinds["builtin_interfaces/msg/Time"](now // 10**9, now % 10**9), "world"
            )
            pose = kinds["geometry_msgs/msg/Transform"](
                place(0.5, 0.01 * i, 0.02), turn(0.0, 0.0, 0.0, 1.0)
            )
            one = kinds["geometry_msgs/msg/TransformStamped"](header, "cube", pose)
            message = kinds["tf2_msgs/msg/TFMessage"]([one])
            bag.write(tf, now, store.serialize_ros1(message, "tf2_msgs/msg/TFMessage"))
    text = '[body.cube]\nshapes = [{ kind = "box", size = [0.02, 0.02, 0.02] }]\n'
    (tmp_path / "cube.toml").write_text(text)
    source = tmp_path / "run.bag"
    done = run("import", source, "--to", tmp_path / "data", "--map", tmp_path / "cube.toml")
    assert done.code == 0, done.err
    episode = load(tmp_path / "data")
    assert np.allclose(episode.track("cube").position[:, 1], 0.01 * np.arange(20))
    assert np.allclose(episode.t, 0.05 * np.arange(20))
