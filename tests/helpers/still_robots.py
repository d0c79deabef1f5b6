"""Demonstrations in which the robot does nothing, made of stored ones: things settle, drop, roll and fall by themselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import h5py
import mujoco
import numpy as np

from simulate.importers.foreign_facts import ForeignFacts
from simulate.importers.model_file import load_model

ROW_DT = 0.05
"""s between rows, as robosuite and LIBERO store them."""
DROP = 0.1
"""m. By up to so much things begin higher: more than any rule lets fall."""


def write_still(
    source: Path,
    target: Path,
    seeds: Sequence[int],
    *,
    assets: Sequence[Path] = (),
    seconds: float = 6.0,
) -> int:
    """Write a file of ``source``'s layout with an episode for each seed and demonstration; how many there are.

    Each begins at the first stored state. With seed 0 that is all; with others every free body is put up to ``DROP``
    higher, turned a little, and pushed by up to 0.2 m/s. The robot's joints stay where they are.
    """
    count = 0
    with h5py.File(source) as old, h5py.File(target, "w") as new:
        data = new.create_group("data")
        data.attrs.update(old["data"].attrs)
        for name, demo in old["data"].items():
            model = load_model(str(demo.attrs["model_file"]), str(source), assets).model
            for seed in seeds:
                group = data.create_group(f"demo_{count}")
                group.attrs["model_file"] = demo.attrs["model_file"]
                rng = np.random.default_rng([seed, sum(map(ord, name))])
                states = np.array(list(_states(model, demo["states"][0], rng, seed > 0, seconds)))
                group["states"] = states
                group["actions"] = np.zeros((len(states), demo["actions"].shape[1]))
                count += 1
    return count


def _states(
    model: mujoco.MjModel, first: np.ndarray, rng: np.random.Generator, stir: bool, seconds: float
) -> Iterator[np.ndarray]:
    """Rows of time, qpos, qvel, as robosuite flattens them; of more entries as many as the source has."""
    facts = ForeignFacts(model)
    data = mujoco.MjData(model)
    data.qpos[:] = first[1 : 1 + model.nq]
    robot_q: list[int] = []
    robot_v: list[int] = []
    for j in range(model.njnt):
        kind = facts.facts[int(model.jnt_bodyid[j])].kind
        width = {0: (7, 6), 1: (4, 3)}.get(int(model.jnt_type[j]), (1, 1))
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        if kind in ("robot", "gripper"):
            robot_q += range(q, q + width[0])
            robot_v += range(v, v + width[1])
        elif width[0] == 7 and stir:
            data.qpos[q + 2] += rng.uniform(0, DROP)
            turned = np.zeros(4)
            mujoco.mju_axisAngle2Quat(turned, rng.normal(size=3), rng.uniform(0, 0.3))
            mujoco.mju_mulQuat(data.qpos[q + 3 : q + 7], data.qpos[q + 3 : q + 7].copy(), turned)
            data.qvel[v : v + 3] = rng.uniform(-0.2, 0.2, 3)
    held = data.qpos[robot_q].copy()
    rest = first[1 + model.nq + model.nv :]
    per_row = max(1, round(ROW_DT / model.opt.timestep))
    for _ in range(int(seconds / ROW_DT)):
        yield np.concatenate([[data.time], data.qpos, data.qvel, rest])
        for _ in range(per_row):
            data.qpos[robot_q], data.qvel[robot_v] = held, 0.0
            mujoco.mj_step(model, data)
        data.qpos[robot_q], data.qvel[robot_v] = held, 0.0
