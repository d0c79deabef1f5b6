"""robosuite's own folders and plain arrays give what the gathered HDF5 file gives."""

import mujoco
import numpy as np
import pytest
from foreign_demos import demo_file, imported, said, scene, settled

from safestage_eval.errors import InputError
from safestage_eval.importers.registry import recognise
from simulate.importers.mujoco import MujocoStates

pytestmark = pytest.mark.simulate


@pytest.fixture
def states():
    return settled(scene())


def same(one, other):
    for name, track in one.tracks.items():
        assert np.array_equal(track.position, other.tracks[name].position)
    assert np.allclose(one.t, other.t)
    assert np.allclose(one.contacts.force, other.contacts.force)


def test_folders_of_robosuites_collector(tmp_path, states):
    folder = tmp_path / "run" / "ep_1700000000_5"
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(scene())
    infos = np.array([{"actions": [0.1]}], dtype=object)
    parts = {"state_1700000001_5": states[:2], "state_1700000001_25": states[2:]}
    # .25 s comes before .5 s, whatever the names say
    parts = {"state_1700000001_25": states[:2], "state_1700000001_5": states[2:]}
    for i, (name, rows) in enumerate(parts.items()):
        np.savez(
            folder / f"{name}.npz", states=rows, action_infos=infos, successful=i == 1, env="Lift"
        )
    assert recognise(tmp_path / "run") == (MujocoStates.name, "ep_1700000000_5/state_*.npz")
    episode, account = imported(tmp_path / "run")
    other, _ = imported(demo_file(tmp_path / "d.hdf5", scene(), states))
    same(episode, other)
    assert (episode.header.task, episode.header.success) == ("Lift", True)
    assert episode.header.success_time is None
    assert said(account, "the moment of success")
    assert recognise(folder) == (MujocoStates.name, "ep_1700000000_5/state_*.npz")


@pytest.mark.parametrize("timed", ["time", "dt", "flag"])
def test_plain_arrays_with_a_model_beside_them(tmp_path, states, timed):
    nq = mujoco.MjModel.from_xml_string(scene()).nq
    time, qpos, qvel = states[:, 0], states[:, 1 : 1 + nq], states[:, 1 + nq :]
    extra = {"time": time} if timed == "time" else {"dt": 0.05} if timed == "dt" else {}
    np.savez(tmp_path / "roll.npz", qpos=qpos, qvel=qvel, ctrl=np.zeros((5, 2)), **extra)
    (tmp_path / "roll.xml").write_text(scene())
    assert recognise(tmp_path / "roll.npz") == (MujocoStates.name, "qpos and qvel")
    if timed == "flag":
        with pytest.raises(InputError, match="--dt"):
            imported(tmp_path / "roll.npz")
    episode, _ = imported(tmp_path / "roll.npz", dt=0.05 if timed == "flag" else None)
    other, _ = imported(demo_file(tmp_path / "d.hdf5", scene(), states))
    same(episode, other)
    assert episode.frames.action.shape == (5, 2)
