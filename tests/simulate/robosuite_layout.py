"""A rollout of ours as robosuite's collector would have stored it: states, a model, commands."""

from __future__ import annotations

import json
import re
from pathlib import Path

import mujoco
import numpy as np
from foreign_demos import demo_file

from safestage_eval.episode import Episode
from simulate.arm import droid
from simulate.policies.policy_names import policy_named
from simulate.record.recorder import Recorder
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import task_named
from simulate.world import world


def rolled_out(task: str, policy: str, to: Path) -> tuple[Episode, Path]:
    """The episode as recorded, and its export: a row per frame, time, qpos and qvel; and ``ctrl``."""
    rows: list[np.ndarray] = []
    ctrl: list[np.ndarray] = []
    look = Recorder._look

    def watched(recorder: Recorder) -> None:
        look(recorder)  # called at the moment that the next frame is of
        data = recorder._world.data
        rows.append(np.concatenate([[data.time], data.qpos, data.qvel]))
        ctrl.append(data.ctrl.copy())

    Recorder._look = watched  # type: ignore[method-assign]
    try:
        episode = roll_out(Setting(task_named(task)), policy_named(policy)).episode()
    finally:
        Recorder._look = look  # type: ignore[method-assign]
    spec = world.scene_spec(task_named(task).models(), substeps=task_named(task).substeps)
    spec.compile()
    kwargs = {"control_freq": world.CONTROL_RATE, "mujoco_version": mujoco.__version__}
    about = {"env": task, "env_info": json.dumps(kwargs)}
    model = renamed(spec.to_xml())
    states = np.array(rows[: len(episode)])
    commands = {"actions": episode.frames.action, "ctrl": np.array(ctrl[: len(episode)])}
    return episode, demo_file(to, model, states, about=about, **commands)


def renamed(text: str) -> str:
    """Bodies of the arm named as robosuite names them."""
    model = mujoco.MjSpec.from_file(str(droid.default_mjcf()))
    gripper = {body.name for body in model.body(droid.GRIPPER_ROOT).find_all("body")}
    gripper.add(droid.GRIPPER_ROOT)

    def name(match: re.Match[str]) -> str:
        start = "gripper0_" if match[2] in gripper else "robot0_"
        return f'{match[1]}="{start}{match[2]}"'

    return re.sub(r'(<body name|body1|body2|body)="robot/([^"]*)"', name, text)


def ours(name: str) -> str:
    """The body's name before the export."""
    return re.sub(r"^(robot0|gripper0)_", "robot_", name)
