"""What ``safestage-record`` costs, as a share of the same rollout without it, in one run.

    python benchmarks/recorder_overhead.py [ENVIRONMENT …]

Run it in the simulator's own environment, with ``recorder/`` on PYTHONPATH. The ways to record (none,
frames alone, every physics step) take turns, short stretches of control steps at a time, on one
environment and with the same actions, so that whatever else the machine does falls on all of them alike.
Processor time of this process; the share is of sums over all stretches. Writing the file is included.
"""

from __future__ import annotations

import gc
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import safestage_record

TURNS, STEPS = 24, 50
WAYS: dict[str, Any] = {
    "nothing": None,
    "frames": {"frame_dt": None, "substeps": False},
    "steps": {"frame_dt": None},
    "0.01 s": {},
}


def lift() -> tuple[Any, Any]:
    """Lift with a Panda under robosuite's own controller."""
    import robosuite

    env = robosuite.make(
        "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False,
        use_camera_obs=False, control_freq=20, horizon=100_000, ignore_done=True,
    )  # fmt: skip
    return env, lambda rng: rng.uniform(-0.5, 0.5, env.action_dim)


def fetch() -> tuple[Any, Any]:
    """Pick and place with a Fetch."""
    import gymnasium
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    env = gymnasium.make("FetchPickAndPlace-v4", max_episode_steps=100_000).unwrapped
    return env, lambda rng: rng.uniform(-1, 1, 4)


def metaworld() -> tuple[Any, Any]:
    """Pick and place with a Sawyer."""
    import gymnasium
    import metaworld as _  # registers

    env = gymnasium.make("Meta-World/MT1", env_name="pick-place-v3", seed=0).unwrapped
    env.max_path_length = 100_000
    return env, lambda rng: rng.uniform(-1, 1, 4)


def bring_ball() -> tuple[Any, Any]:
    """A planar arm in dm_control."""
    from dm_control import suite

    env = suite.load("manipulator", "bring_ball", task_kwargs={"time_limit": 1e6})
    return env, lambda rng: rng.uniform(-1, 1, env.action_spec().shape)


ENVIRONMENTS = {"robosuite": lift, "fetch": fetch, "metaworld": metaworld, "dm_control": bring_ball}


def measure(make: Any) -> dict[str, float]:
    """Return s of processor time by way of recording, over all turns, and the control steps."""
    env, draw = make()
    spent = dict.fromkeys(WAYS, 0.0)
    gc.disable()
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(TURNS):
            for name, settings in WAYS.items():
                rng = np.random.default_rng(turn)
                env.reset()
                model, data = safestage_record.env_wrap.find_simulation(env)
                actions = [draw(rng) for _ in range(STEPS)]
                begin = time.process_time()
                if settings is None:
                    for action in actions:
                        env.step(action)
                else:
                    path = Path(folder) / f"{turn}.{name}.zip"
                    with safestage_record.mujoco(model, data, path, **settings) as recorder:
                        prepared = time.process_time()
                        for action in actions:
                            env.step(action)
                            recorder.step(action)
                    begin += 0 * prepared
                if turn:  # the first one warms up
                    spent[name] += time.process_time() - begin
                gc.collect()
    return spent


def main() -> None:
    for name in sys.argv[1:] or ENVIRONMENTS:
        spent = measure(ENVIRONMENTS[name])
        steps = (TURNS - 1) * STEPS
        plain = spent["nothing"]
        shares = ", ".join(f"{way} {spent[way] / plain - 1:+.1%}" for way in WAYS if way != "nothing")
        print(f"{name}: {1e3 * plain / steps:.2f} ms a control step; {shares}")


if __name__ == "__main__":
    main()
