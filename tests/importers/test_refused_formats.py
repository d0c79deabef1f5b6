"""Recordings without objects are refused: the message says why, and what records such rollouts whole."""

import h5py
import numpy as np
import pytest
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


def test_a_folder_of_them_says_it_once(tmp_path):
    for number in range(3):
        aloha(tmp_path / f"aloha/episode_{number}.hdf5")
    done = run("import", tmp_path / "aloha", "--to", tmp_path / "data")
    assert done.err.count("has no poses of objects") == 1
    assert "So are 2 more." in done.err
    assert "3 not imported" in done.err
