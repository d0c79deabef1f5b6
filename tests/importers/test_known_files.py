"""Files that cannot be imported are named: what they are, what they lack, and what to do."""

import h5py
import numpy as np
import pytest
from mcap_ros2.writer import Writer
from studio import run


def raw_droid(path):
    """An episode's folder, as DROID's raw data has it."""
    path.mkdir(parents=True)
    with h5py.File(path / "trajectory.h5", "w") as file:
        for name, width in (("cartesian_position", 6), ("joint_position", 7)):
            file[f"action/{name}"] = np.zeros((5, width))
        for name, width in (("cartesian_position", 6), ("joint_positions", 7)):
            file[f"observation/robot_state/{name}"] = np.zeros((5, width))
        file["observation/timestamp/control/step_start"] = np.arange(5)
    (path / "metadata_AUTOLab+0d4edc83.json").write_text("{}")


def aloha(path):
    """A file of ALOHA's."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for name in ("qpos", "qvel", "effort"):
            file[f"observations/{name}"] = np.zeros((5, 14))
        file["observations/images/cam_high"] = np.zeros((5, 4, 4, 3), np.uint8)
        file["action"] = np.zeros((5, 14))


@pytest.mark.parametrize(
    ("make", "where", "why"),
    [
        (
            raw_droid,
            "droid/AUTOLab/success/2023-07-07/one",
            "where objects were was never measured",
        ),
        (aloha, "aloha/episode_0.hdf5", "never where objects were"),
    ],
)
def test_robots_without_objects_name_the_recorder(tmp_path, make, where, why):
    make(tmp_path / where)
    for source in (tmp_path / where, tmp_path / where.split("/")[0]):
        done = run("import", source, "--to", tmp_path / "data")
        assert done.code == 2
        assert "has no poses of objects" in done.err
        assert why in done.err
        assert "safestage-record" in done.err


def zeros(path, *names, attrs=None):
    """An HDF5 file with datasets of these names, and attributes of groups."""
    with h5py.File(path, "w") as file:
        for name in names:
            file[name] = np.zeros((5, 7))
        for group, (key, value) in (attrs or {}).items():
            file.require_group(group).attrs[key] = value
    return path


def mcap_of_joints(path):
    with path.open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/joint_text", schema, {"data": "x"}, 0, 0)
        writer.finish()


FILES = {
    "run.hdf5": (lambda p: p.write_text("version https://git-lfs.github.com/spec/v1\noid"), "lfs pull"),
    "run.rrd": (lambda p: p.write_bytes(b"RRF2" + bytes(40)), "Rerun"),
    "run.ulg": (lambda p: p.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(40)), "PX4"),
    "a.npz": (lambda p: np.savez(p, joints=np.zeros(3)), "(joints)"),
    "a.pruned_init": (lambda p: p.write_bytes(b"PK\x03\x04" + bytes(40)), "no motion"),
    "hive.h5": (lambda p: zeros(p, "Trial0/env_infos/time", "Trial0/time"), "RoboHive"),
    "og.hdf5": (
        lambda p: zeros(p, "data/demo_0/state", attrs={"data": ("scene_file", "{}")}), "OmniGibson",
    ),
    "empty.hdf5": (lambda p: zeros(p, attrs={"data": ("total", 0)}), "no demonstration in it"),
    "other.hdf5": (lambda p: zeros(p, "a/b"), "no layout that is known"),
    "run.mcap": (mcap_of_joints, "/joint_text (std_msgs/msg/String)"),
    "old.hdf5": (
        lambda p: zeros(p, "data/demo_1/states", attrs={"data/demo_1": ("model_file", "lift.xml")}),
        "is the name of a file",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_named_with_what_to_do(tmp_path, name):
    make, words = FILES[name]
    make(tmp_path / name)
    done = run("import", tmp_path / name, "--to", tmp_path / "data")
    assert done.code == 2
    assert words in done.err
    assert "Fix: " in done.err
    assert "bug" not in done.err


def test_a_folder_of_unknown_files_is_named_with_a_count(tmp_path):
    for number in range(3):
        np.savez(tmp_path / f"{number}.npz", joints=np.zeros(3))
    (tmp_path / "mesh.stl").write_text("version https://git-lfs.github.com/spec/v1\noid")
    done = run("import", tmp_path, "--to", tmp_path / "data")
    assert done.err.count("a NumPy archive") == 1
    assert "So are 2 more" in done.err


def test_scoring_such_a_file_names_the_import(tmp_path):
    for make, name in ((lambda p: zeros(p, "a/b"), "a.hdf5"), (mcap_of_joints, "a.mcap")):
        make(tmp_path / name)
        done = run("score", tmp_path / name)
        assert "safestage import " in done.err + done.text


def test_one_problem_of_many_demonstrations_is_told_once(tmp_path):
    path = tmp_path / "old.hdf5"
    attrs = {f"data/demo_{i}": ("model_file", "lift.xml") for i in range(3)}
    zeros(path, *(f"data/demo_{i}/states" for i in range(3)), attrs=attrs)
    done = run("import", path, "--to", tmp_path / "data")
    assert done.err.count("is the name of a file") == 1
    assert "So are 2 more." in done.err
    assert "3 not imported" in done.err
