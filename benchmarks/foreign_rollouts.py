"""Records rollouts of scripted policies in other people's simulators, scores them, and writes the page.

    python benchmarks/foreign_rollouts.py record metaworld FOLDER [--seeds 0-6]   # in its environment
    python benchmarks/foreign_rollouts.py page FOLDER docs/foreign_rollouts.md    # in SafeStage's

Both need ``recorder/`` and ``benchmarks/`` on PYTHONPATH, the page the repository's root, too. Every environment writes
FOLDER/NAME/TASK.SEED.zip; one that is there already is left alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import safestage_record
from foreign_policies import pick_and_place, push

HOLD = 5.0
"""s recorded after success with the robot still; rules of final states ask for five."""


def metaworld(folder: Path, seeds: range) -> None:
    """Meta-World's scripted experts in all of its 50 tasks, until success or 500 steps."""
    import metaworld as package
    from metaworld.policies import ENV_POLICY_MAP

    for name in sorted(ENV_POLICY_MAP):
        bench = package.MT1(name, seed=0)
        env = bench.train_classes[name]()
        env.max_path_length = 100_000
        policy = ENV_POLICY_MAP[name]()
        for seed in _missing(folder, name, seeds):
            env.set_task(bench.train_tasks[seed])
            env.seeded_rand_vec = True

            def actions(obs: Any, policy: Any = policy) -> Any:
                return np.clip(policy.get_action(obs), -1, 1)

            _roll(
                env, folder, name, seed, actions, 500, lambda last: np.array([0, 0, 0, last[3]]),
                policy="metaworld expert", instruction=name,
            )  # fmt: skip


def fetch(folder: Path, seeds: range) -> None:
    """Gymnasium-Robotics: the Fetch picks and places, and pushes, by a script."""
    import gymnasium

    gymnasium.register_envs(import_module("gymnasium_robotics"))
    for task in ("FetchPickAndPlace-v4", "FetchPush-v4"):
        env = gymnasium.make(task, max_episode_steps=100_000).unwrapped
        for seed in _missing(folder, task, seeds):
            now: dict[str, Any] = {}
            see = {
                "hand": lambda now=now: now["observation"][:3],
                "thing": lambda now=now: now["observation"][3:6],
                "goal": lambda now=now: now["desired_goal"],
                "act": lambda move, closed: np.append(move, -closed),
            }
            script = (
                push(**see, gain=10.0)
                if "Push" in task
                else pick_and_place(**see, gain=10.0, release=False)
            )
            _roll(
                env, folder, task, seed, _scripted(now, script), 150,
                lambda last: np.array([0, 0, 0, last[3]]), policy="script", instruction=task,
            )  # fmt: skip


def robosuite(folder: Path, seeds: range) -> None:
    """robosuite: a Panda lifts, stacks, and puts a can into its bin, by a script."""
    import robosuite as package

    for task in ("Lift", "Stack", "PickPlaceCan"):
        for seed in _missing(folder, task, seeds):
            env = package.make(
                task, robots="Panda", has_renderer=False, has_offscreen_renderer=False,
                use_camera_obs=False, control_freq=20, horizon=100_000, ignore_done=True, seed=seed,
            )  # fmt: skip
            now: dict[str, Any] = {}
            _roll(
                env, folder, task, seed, _scripted(now, _robosuite_script(env, task, now)), 300,
                lambda last: np.append(np.zeros(6), last[6]), policy="script", instruction=task,
            )  # fmt: skip


def _robosuite_script(env: Any, task: str, now: dict[str, Any]) -> Iterator[Any]:
    def act(move: Any, closed: float) -> Any:
        return np.concatenate([move, np.zeros(3), [closed]])

    def goal() -> Any:
        if task == "Stack":
            return now["cubeB_pos"] + [0, 0, 0.045]
        if task == "Lift":
            return now["goal"]
        return np.add(env.target_bin_placements[env.object_to_id["can"]], [0, 0, 0.1])

    name = {"Lift": "cube_pos", "Stack": "cubeA_pos", "PickPlaceCan": "Can_pos"}[task]

    def thing() -> Any:
        now.setdefault("goal", now[name] + [0, 0, 0.15])
        return now[name]

    return pick_and_place(
        lambda: now["robot0_eef_pos"], thing, goal, act,
        gain=15.0, above=0.25 if "Can" in task else 0.12, release=task != "Lift",
    )  # fmt: skip


def mani_skill(folder: Path, seeds: range) -> None:
    """ManiSkill on the CPU: a Panda picks and stacks cubes by a script, and pushes one."""
    import_module("sapien_without_vulkan")
    import gymnasium

    import_module("mani_skill.envs")
    for task in ("PickCube-v1", "StackCube-v1", "PushCube-v1"):
        env = gymnasium.make(
            task, num_envs=1, obs_mode="state_dict", render_mode=None,
            control_mode="pd_ee_delta_pos", sim_backend="physx_cpu", render_backend="none",
        ).unwrapped  # fmt: skip
        for seed in _missing(folder, task, seeds):
            now: dict[str, Any] = {"up": None}

            def place(of: Any) -> Any:
                return of.pose.p[0].numpy().astype(float)

            target = env.cubeA if task == "StackCube-v1" else (
                env.obj if task == "PushCube-v1" else env.cube
            )  # fmt: skip

            def goal(task: str = task, env: Any = env) -> Any:
                if task == "StackCube-v1":
                    return place(env.cubeB) + np.array([0, 0, 0.04])
                if task == "PushCube-v1":
                    return place(env.goal_region) * [1, 1, 0] + np.array([0, 0, 0.02])
                return place(env.goal_site)

            see = {
                "hand": lambda env=env: place(env.agent.tcp),
                "thing": lambda target=target: place(target),
                "goal": goal,
                "act": lambda move, closed: np.append(move, -closed).astype(np.float32),
            }
            script = (
                push(**see, gain=10.0)
                if task == "PushCube-v1"
                else pick_and_place(**see, gain=8.0, release=task == "StackCube-v1")
            )
            _roll(
                env, folder, task, seed, _scripted(now, script), 150,
                lambda last: np.append(np.zeros(3), last[3]).astype(np.float32),
                policy="script", instruction=task,
            )  # fmt: skip


MAKERS = {"metaworld": metaworld, "fetch": fetch, "robosuite": robosuite, "mani_skill": mani_skill}


def _scripted(now: dict[str, Any], script: Iterator[Any]) -> Any:
    """A function of observations that runs a script which reads them from ``now``."""

    def actions(obs: Any) -> Any:
        if isinstance(obs, dict):
            now.update(obs)
        return next(script)

    return actions


def _missing(folder: Path, task: str, seeds: range) -> list[int]:
    return [seed for seed in seeds if not (folder / f"{task}.{seed}.zip").exists()]


def _roll(
    env: Any,
    folder: Path,
    task: str,
    seed: int,
    actions: Any,
    steps: int,
    still: Any,
    **header: Any,
) -> None:
    """Record one episode until its success, and then hold; or for as many steps."""
    try:
        result = env.reset(seed=seed)
    except TypeError:  # robosuite
        result = env.reset()
    obs = result[0] if isinstance(result, tuple) else result
    path = folder / f"{task}.{seed}.zip"
    recorder = safestage_record.find_backend.begin_recording(
        env, path, task=task, seed=seed, up="guess", **header
    )
    with recorder:
        for _ in range(steps):
            action = actions(obs)
            result = env.step(action)
            obs = result[0]
            recorder.step(action)
            if _reached(env, result[-1]):
                recorder.success(True)
                break
        else:
            recorder.success(False)
            recorder.header(termination="horizon")
        if recorder.succeeded:
            begin, rest = recorder.time, still(action)
            while recorder.time - begin < HOLD:
                env.step(rest)
                recorder.step(rest)
            recorder.header(post_success_hold=recorder.time - begin)
    print(
        f"{path.name}: {'success' if recorder.succeeded else 'no success'}, {len(recorder)} frames"
    )


def _reached(env: Any, info: Any) -> bool:
    for name in ("success", "is_success"):
        if name in info:
            return bool(np.all(np.asarray(info[name])))
    return bool(env._check_success())  # noqa: SLF001  robosuite has no other


def main() -> None:
    """Record, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    record = commands.add_parser("record")
    record.add_argument("name", choices=sorted(MAKERS))
    record.add_argument("folder", type=Path)
    record.add_argument("--seeds", default="0-6", help="first and last, as 0-6")
    page = commands.add_parser("page")
    page.add_argument("folder", type=Path)
    page.add_argument("page", type=Path)
    given = parser.parse_args()
    if given.command == "record":
        first, _, last = given.seeds.partition("-")
        folder = given.folder / given.name
        MAKERS[given.name](folder, range(int(first), int(last or first) + 1))
    else:
        import_module("foreign_page").write_page(given.folder, given.page)


if __name__ == "__main__":
    main()
