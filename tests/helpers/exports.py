"""Traces of ours in the layouts of others, with their quirks, and the map files that go with them."""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.pose import rotate

RIGID = ("object", "fixture", "region")


def map_text(
    episode: Episode,
    *,
    shapes: bool = True,
    success: bool = False,
    unshaped: Collection[str] = (),
) -> str:
    """Facts that a foreign layout lacks: roles, rules, and everything of a body but its motion.

    ``unshaped``: bodies of which no shape is given.
    """
    header = episode.header
    said: dict[str, Any] = {
        "task": header.task, "stage": header.stage, "family": header.family,
        "rules": list(header.rules),
        "goal": header.goal if isinstance(header.goal, str) else None,
    }  # fmt: skip
    if success:
        said |= {"success": header.success, "success_time": header.success_time}
        said |= {"post_success_hold": header.post_success_hold}
    lines = ["[every]", *_entries(said)]
    lines += ["roles = " + _inline({k: list(v) for k, v in header.roles.items()})]
    lines += ["parameters = " + _inline(header.parameters)]
    for body in header.bodies:
        if body.kind in RIGID:
            lines += [
                f'[body."{body.name}"]',
                *_entries(_body(body, shapes=shapes and body.name not in unshaped)),
            ]
    return "\n".join(lines) + "\n"


def _body(body: Body, *, shapes: bool) -> dict[str, Any]:
    out: dict[str, Any] = {
        "kind": body.kind, "mass": body.mass, "com": list(body.com), "tags": list(body.tags),
        "material": body.material, "parent": body.parent, "excluded": list(body.excluded),
        "up": False if body.up_axis is None else list(body.up_axis), "cavity": False,
    }  # fmt: skip
    if body.cavity is not None:
        out["cavity"] = body.cavity.model_dump(mode="json")
    if shapes:
        keys = ("kind", "size", "position", "orientation", "friction")
        out["shapes"] = [{k: g.model_dump(mode="json")[k] for k in keys} for g in body.geoms]
    return out


def _entries(table: dict[str, Any]) -> list[str]:
    return [f"{key} = {_inline(value)}" for key, value in table.items() if value is not None]


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f'"{k}" = {_inline(v)}' for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)


def com_twist(episode: Episode, body: Body) -> np.ndarray:
    """(T, 6) velocity of the centre of mass, angular velocity; world."""
    track = episode.track(body.name)
    arm = rotate(track.orientation, np.asarray(body.com, float))
    linear = track.linear_velocity + np.cross(track.angular_velocity, arm)
    return np.hstack([linear, track.angular_velocity]).astype(np.float32)


def corners_mm(episode: Episode, body: Body) -> np.ndarray:
    """(T, 8, 3) int16: of the box around the body's shapes, cut off to whole millimetres."""
    [geom] = body.geoms
    assert geom.kind == "box"
    track = episode.track(body.name)
    signs = np.array([[1 if i >> axis & 1 else -1 for axis in range(3)] for i in range(8)])
    inner = rotate(geom.orientation, signs * np.array(geom.size)) + np.array(geom.position)
    world = rotate(np.repeat(track.orientation, 8, axis=0), np.tile(inner, (len(episode), 1)))
    world = world.reshape(-1, 8, 3) + track.position[:, None].astype(float)
    return np.trunc(world * 1000).astype(np.int16)


def pose(episode: Episode, name: str, order: str = "wxyz") -> np.ndarray:
    """(T, 7) position, quaternion."""
    track = episode.track(name)
    turn = track.orientation if order == "wxyz" else track.orientation[:, [1, 2, 3, 0]]
    return np.hstack([track.position, turn]).astype(np.float32)


def write_robolab(
    folder: Path,
    episodes: list[Episode],
    *,
    version: str | None = "2.3.2.post1",
    order: str = "wxyz",
    boxes: bool = True,
    beside: bool = True,
    results: bool = True,
) -> Path:
    """``<folder>/<task>/run_0.hdf5``, ``env_cfg.json`` and ``<folder>/episode_results.jsonl``.

    As RoboLab 0.2.1 writes them: one row of ``initial_state``, then one row per action and step;
    cameras as xyzw; ``subtask`` with one more row; recording ends at success.
    """
    task = episodes[0].header.task or "Task"
    path = folder / task / "run_0.hdf5"
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = []
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": task, "type": 2})
        data.attrs["total"] = sum(map(len, episodes))
        if version is not None:
            data.attrs["isaaclab_version"] = version
        for i, episode in enumerate(episodes):
            _robolab_demo(data.create_group(f"demo_{i}"), episode, order, boxes=boxes)
            lines.append(
                {
                    "env_name": task, "task_name": task, "run": 0, "env_id": i, "episode": i,
                    "policy": "pi05", "instruction": "do it", "instruction_type": "default",
                    "success": bool(episode.header.success), "dt": episode.header.frame_dt,
                }
            )  # fmt: skip
    if beside:
        dt = episodes[0].header.frame_dt
        flat = [1.0, 0.0, 0.0, 0.0] if order == "wxyz" else [0.0, 0.0, 0.0, 1.0]
        config = {
            "sim": {"dt": dt / 8, "render_interval": 8, "gravity": [0.0, 0.0, -9.81]},
            "decimation": 8, "episode_length_s": 60, "seed": 3, "_task_name": task,
            "scene": {"robot": {"init_state": {"pos": [0, 0, 0], "rot": flat}}, "num_envs": 1},
            "instruction": "do it",
            "terminations": {
                "time_out": {"func": "isaaclab.envs.mdp.terminations:time_out", "params": {},
                             "time_out": True},
                "success": {
                    "func": "robolab.core.task.conditionals:object_in_container",
                    "params": {"object": ["cube"], "container": "carton", "logical": "all"},
                    "time_out": False,
                },
            },
        }  # fmt: skip
        (path.parent / "env_cfg.json").write_text(json.dumps(config))
    if results:
        text = "".join(json.dumps(line) + "\n" for line in lines)
        (folder / "episode_results.jsonl").write_text(text)
    return path


def _robolab_demo(demo: Any, episode: Episode, order: str, *, boxes: bool) -> None:
    header = episode.header
    last = len(episode)
    if header.success_time is not None:
        last = int(np.searchsorted(episode.t, header.success_time - 1e-9)) + 1
    steps = last - 1
    demo.attrs["num_samples"], demo.attrs["seed"] = steps, 3
    demo.attrs["success"] = bool(header.success)

    def put(path: str, values: np.ndarray) -> None:
        for part, rows in (("initial_state", slice(0, 1)), ("states", slice(1, last))):
            demo.create_dataset(f"{part}/{path}", data=values[rows], compression="gzip")

    for body in header.bodies:
        if body.kind in RIGID:
            put(f"rigid_object/{body.name}/root_pose", pose(episode, body.name, order))
            put(f"rigid_object/{body.name}/root_velocity", com_twist(episode, body))
            if boxes and len(body.geoms) == 1 and body.geoms[0].kind == "box":
                data = corners_mm(episode, body)[1:last]
                demo.create_dataset(f"bbox/bbox_mm/{body.name}", data=data)
                centre = data.mean(axis=1).astype(np.float16) / np.float16(1000)
                demo.create_dataset(f"bbox/centroid/{body.name}", data=centre)
    base = np.tile(
        np.float32([0, 0, 0, *([1, 0, 0, 0] if order == "wxyz" else [0, 0, 0, 1])]),
        (len(episode), 1),
    )
    put("articulation/robot/root_pose", base)
    put("articulation/robot/root_velocity", np.zeros((len(episode), 6), np.float32))
    closing = np.linspace(0, np.pi / 4, len(episode), dtype=np.float32)
    joints = np.zeros((len(episode), 13), np.float32)
    joints[:, :7] = np.arange(7)
    joints[:, 7] = closing
    put("articulation/robot/joint_position", joints)
    put("articulation/robot/joint_velocity", np.zeros_like(joints))
    demo["actions"] = np.tile(np.arange(steps, dtype=np.float32)[:, None], (1, 8))
    noise = np.random.default_rng(0).normal(0, 0.05, steps)
    demo["obs/gripper_pos"] = np.clip(closing[:steps] / (np.pi / 4) + noise, 0, 1).astype("f4")
    hand = next((b for b in header.bodies if b.kind == "gripper"), None)
    if hand is not None:
        track = episode.track(hand.name)
        demo["ee_pose/position"] = track.position[1:last]
        demo["ee_pose/orientation"] = pose(episode, hand.name, order)[1:last, 3:]
        demo["ee_pose/linear_velocity"] = track.linear_velocity[1:last]
        demo["ee_pose/angular_velocity"] = track.angular_velocity[1:last]
    for part, kind in (("completed", "u1"), ("score", "f4"), ("status", "u2")):
        demo[f"subtask/{part}"] = np.zeros(steps + 1, kind)
    demo["initial_state/cameras/wrist_cam/position"] = np.zeros((1, 3), "f4")
    demo["initial_state/cameras/wrist_cam/orientation"] = np.float32([[0, 0, 0, 1]])


def write_maniskill(folder: Path, episode: Episode, *, rate: bool = True) -> Path:
    """``trajectory.h5`` and ``.json`` as ManiSkill 3's RecordEpisode writes them."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "trajectory.h5"
    header, steps = episode.header, len(episode) - 1
    with h5py.File(path, "w") as file:
        group = file.create_group("traj_0", track_order=True)
        group["actions"] = np.zeros((steps, 8), np.float32)
        for name in ("terminated", "truncated", "fail"):
            group[name] = np.zeros(steps, bool)
        if header.success is not None:
            reached = np.zeros(steps, bool)
            if header.success_time is not None:
                reached = episode.t[1:] >= header.success_time - 1e-9
            group["success"] = reached
        for body in header.bodies:
            if body.kind in RIGID:
                values = np.hstack([pose(episode, body.name), com_twist(episode, body)])
                group[f"env_states/actors/{body.name}"] = values
        root = np.tile(np.float32([-0.6, 0, 0, 1, *[0] * 9]), (len(episode), 1))
        joints = np.zeros((len(episode), 18), np.float32)
        group["env_states/articulations/panda"] = np.hstack([root, joints])
    kwargs: dict[str, Any] = {"obs_mode": "state", "robot_uids": "panda"}
    if rate:
        kwargs["sim_config"] = {
            "control_freq": 1 / header.frame_dt,
            "sim_freq": 1 / header.physics_dt,
        }
    about = {
        "env_info": {"env_id": header.task, "env_kwargs": kwargs, "max_episode_steps": 10_000},
        "source_type": "motionplanning",
        "episodes": [{"episode_id": 0, "episode_seed": 4, "elapsed_steps": steps}],
    }
    path.with_suffix(".json").write_text(json.dumps(about))
    return path


def write_lerobot(folder: Path, episodes: list[Episode], version: str = "v2.1") -> tuple[Path, str]:
    """The dataset's folder, and the ``[columns]`` of its map file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "meta").mkdir()
    names = [b.name for b in episodes[0].header.bodies if b.kind in RIGID]
    tables = []
    for number, episode in enumerate(episodes):
        state = np.hstack([pose(episode, name, "xyzw") for name in names])
        twist = np.hstack(
            [
                np.hstack(
                    [getattr(episode.track(n), f"{k}_velocity") for k in ("linear", "angular")]
                )
                for n in names
            ]
        )
        rows = len(episode)
        tables.append(
            pa.table(
                {
                    "observation.environment_state": list(state.astype(np.float32)),
                    "observation.twists": list(twist.astype(np.float32)),
                    "action": list(np.zeros((rows, 7), np.float32)),
                    "timestamp": episode.t.astype(np.float32),
                    "frame_index": np.arange(rows),
                    "episode_index": np.full(rows, number),
                    "task_index": np.zeros(rows, int),
                }
            )
        )
    if version.startswith("v2"):
        for number, table in enumerate(tables):
            file = folder / f"data/chunk-000/episode_{number:06d}.parquet"
            file.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(table, file)
        (folder / "meta/tasks.jsonl").write_text('{"task_index": 0, "task": "do it"}\n')
    else:
        (folder / "data/chunk-000").mkdir(parents=True)
        pq.write_table(pa.concat_tables(tables), folder / "data/chunk-000/file-000.parquet")
        pq.write_table(
            pa.table({"task_index": [0], "task": ["do it"]}), folder / "meta/tasks.parquet"
        )
    info = {
        "codebase_version": version, "robot_type": "panda", "fps": round(1 / episodes[0].dt),
        "features": {
            "observation.environment_state": {"dtype": "float32", "shape": [7 * len(names)]},
            "action": {"dtype": "float32", "shape": [7]}, "timestamp": {"dtype": "float32"},
        },
    }  # fmt: skip
    (folder / "meta/info.json").write_text(json.dumps(info))
    lines = []
    for i, name in enumerate(names):
        lines += [f'[columns.body."{name}"]']
        for j, (part, width) in enumerate((("position", 3), ("orientation", 4))):
            first = 7 * i + 3 * j
            lines.append(f'{part} = "observation.environment_state[{first}:{first + width}]"')
        for j, part in enumerate(("linear_velocity", "angular_velocity")):
            first = 6 * i + 3 * j
            lines.append(f'{part} = "observation.twists[{first}:{first + 3}]"')
    return folder, "\n".join(lines) + '\n[source]\nquaternion = "xyzw"\n'
