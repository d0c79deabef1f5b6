"""Environments: a trace for every episode, success from what the environment says."""

import json
import zipfile

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from test_mujoco_recorder import scene  # noqa: E402

import safestage_record  # noqa: E402


class Env:
    """Stands for Gymnasium's environment: ends by time after 12 steps, reaches its goal in the sixth."""

    def __init__(self, key="is_success"):
        self.model, self.data = scene()
        self.key, self.closed, self.actions = key, False, []

    def reset(self, seed=None):
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        self.count = 0
        return self.data.qpos.copy(), {}

    def step(self, action):
        self.count += 1
        self.actions.append(list(action))
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, nstep=10)
        info = {self.key: float(self.count >= 6)} if self.key else {}
        return self.data.qpos.copy(), 0.0, False, self.count == 12, info

    def close(self):
        self.closed = True


def header(path):
    with zipfile.ZipFile(str(path)) as archive:
        return json.loads(archive.read("safestage.json"))["header"]


@pytest.mark.parametrize(
    ("key", "success"), [("success", True), ("is_success", True), (None, None)]
)
def test_every_episode_is_a_trace_with_its_success(tmp_path, key, success):
    inner = Env(key)
    env = safestage_record.wrap(inner, tmp_path, roles={"target": "cube"}, task="pick/it")
    assert env is inner
    for seed in (7, 8):
        env.reset(seed=seed)
        for _ in range(12):
            env.step(np.zeros(3))
    env.close()
    assert env.closed
    assert [path.name for path in env.safestage.paths] == ["pick_it.00000.zip", "pick_it.00001.zip"]
    for seed, path in zip((7, 8), env.safestage.paths):
        said = header(path)
        assert said["success"] is success
        assert said["seed"] == seed
        assert said["roles"] == {"target": ["cube"]}
        assert said["termination"] == ("success" if success else "horizon")
        if success:
            assert said["success_time"] == pytest.approx(6 * 0.02, abs=0.011)


def test_after_success_the_robot_is_held_still(tmp_path):
    env = safestage_record.wrap(Env(), tmp_path, hold=1.0, hold_action=lambda last: last)
    env.reset()
    for i in range(6):
        env.step(np.full(3, 0.01 * i))
    env.safestage.finish()
    said = header(env.safestage.paths[0])
    assert said["post_success_hold"] == pytest.approx(1.0)
    assert len(env.actions) == 6 + 50
    assert env.actions[-1] == env.actions[5]


def test_traces_of_an_earlier_run_are_kept(tmp_path):
    for _ in range(2):
        env = safestage_record.wrap(Env(), tmp_path, task="pick")
        env.reset()
        env.step(np.zeros(3))
        env.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pick.00000.zip", "pick.00001.zip"]


def test_an_episode_without_a_step_is_no_trace(tmp_path):
    env = safestage_record.wrap(Env(), tmp_path)
    env.reset()
    env.reset()
    env.close()
    assert env.safestage.paths == []
