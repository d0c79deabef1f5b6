"""LeRobot's vector environments and vla-eval's benchmarks: a trace for each episode that counts."""

from types import SimpleNamespace

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from test_env_wrap import Env, header  # noqa: E402

import safestage_record  # noqa: E402


class Late:
    """Stands for LeRobot's environment of LIBERO: its simulation is made at the first reset; it resets itself."""

    def __init__(self):
        self._env = None

    def reset(self, seed=None, options=None):
        self._env = self._env or Env()
        return self._env.reset()

    def step(self, action):
        obs, reward, _, _, info = self._env.step(action)
        reached = bool(info["is_success"])
        if reached:
            self.reset()
        return obs, reward, reached, False, info


class Vector:
    """Stands for Gymnasium's SyncVectorEnv."""

    def __init__(self, count):
        self.envs = [Late() for _ in range(count)]

    def reset(self, seed):
        for i, env in enumerate(self.envs):
            env.reset(seed=seed + i, options={"new_rollout": True})

    def step(self):
        for env in self.envs:
            env.step(np.zeros(3))


def test_lerobot_counts_one_episode_of_each_environment(tmp_path):
    envs = {"suite": {3: Vector(2)}}
    assert safestage_record.lerobot(envs, tmp_path, task="pick") is envs
    vector = envs["suite"][3]
    for seed in (10, 20):
        vector.reset(seed)
        for _ in range(9):  # it succeeds at the sixth, and resets itself
            vector.step()
    traces = sorted(tmp_path.rglob("*.zip"))
    assert [str(t.relative_to(tmp_path)) for t in traces] == [
        f"suite/3/{i}/pick.0000{k}.zip" for i in (0, 1) for k in (0, 1)
    ]
    for trace in traces:
        said = header(trace)
        assert (said["success"], said["termination"]) == (True, "success")
        assert said["success_time"] == pytest.approx(0.12, abs=0.011)
    assert [header(t)["seed"] for t in traces] == [10, 20, 11, 21]


def test_environments_in_other_processes_are_refused(tmp_path):
    with pytest.raises(safestage_record.RecordError, match="use_async_envs=false"):
        safestage_record.lerobot(SimpleNamespace(), tmp_path)


class Benchmark:
    """Stands for a StepBenchmark of vla-eval."""

    def __init__(self):
        self._env, self.cleaned = None, False

    def reset(self, task):
        self._env = Env()
        return self._env.reset()[0]

    def step(self, action):
        obs, reward, _, _, info = self._env.step(action["actions"])
        done = bool(info["is_success"])
        return SimpleNamespace(obs=obs, reward=reward, done=done, info=info)

    def get_step_result(self, result):
        return {"success": result.done}

    def cleanup(self):
        self.cleaned = True


def test_vla_eval_records_each_episode_of_a_benchmark(tmp_path):
    benchmark = safestage_record.vla_eval(Benchmark(), tmp_path, roles={"target": "cube"})
    for name in ("stack", "pour"):
        benchmark.reset({"name": name, "episode_idx": 0})
        for _ in range(6):
            benchmark.step({"actions": np.zeros(3)})
    benchmark.cleanup()
    assert benchmark.cleaned
    traces = sorted(tmp_path.iterdir())
    assert [t.name for t in traces] == ["pour.00000.zip", "stack.00000.zip"]
    for trace in traces:
        assert header(trace)["success"] is True
        assert header(trace)["roles"] == {"target": ["cube"]}
