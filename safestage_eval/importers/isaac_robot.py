"""Joints, actions and gripper of a RoboLab or Isaac Lab demo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Joint, RobotFrames
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account
from .place_robot import Placed
from .scene_builder import robot_frames

F64 = NDArray[np.float64]

CLOSED = np.pi / 4
"""rad, RoboLab's finger joint when the gripper is closed (robolab/robots/droid.py)."""


def robot_columns(
    group: Any,
    length: int,
    where: str,
    account: Account,
    placed: Mapping[str, Placed] | None = None,
) -> tuple[RobotFrames, tuple[Joint, ...]]:
    """Read columns and joints of all articulations of a demo, by name.

    Args:
        group: of the demo, with ``states`` and perhaps ``initial_state``.
        length: T, frames of its bodies.
        where: for messages.
        account: for remarks.
        placed: articulation → its links, where a description placed them.

    Raises:
        TraceError: an articulation has other frames than the bodies.
    """
    states, first = group["states"], group.get("initial_state")
    columns: dict[str, list[F64]] = {"joint_position": [], "joint_velocity": []}
    joints: list[Joint] = []
    for name in sorted(states.get("articulation", ())):
        before = None if first is None else first.get(f"articulation/{name}")
        for key, parts in columns.items():
            place = f"{where}/{name}"
            values = rows_with_first(states["articulation"][name], before, key, place)
            if len(values) != length:
                raise TraceError(
                    f"{place}/{key}", f"{len(values)} frames, the bodies have {length}"
                )
            parts.append(values)
        whole = (placed or {}).get(name)
        if whole is not None:
            joints += whole.joints
            continue
        own = f"{name}_base" if name in ("robot", "gripper") else name
        joints += [
            Joint(name=f"{name}_{i}", kind="revolute", body=own)
            for i in range(columns["joint_position"][-1].shape[1])
        ]
    none = np.zeros((length, 0))
    position = np.hstack([none, *columns["joint_position"]])
    rows = length - (0 if first is None else 1)
    frames = robot_frames(
        length, joint_position=position,
        joint_velocity=np.hstack([none, *columns["joint_velocity"]]),
        action=_actions(group, length, rows, where, account),
        gripper=next(iter(placed.values())).gripper
        if placed
        else _opening(group, position, where, account),
    )  # fmt: skip
    return frames, tuple(joints)


def _actions(group: Any, length: int, states: int, where: str, account: Account) -> F64:
    """Return (T, A): row i is in force from frame i on; the last one is kept."""
    if "actions" not in group:
        return np.zeros((length, 0))
    actions = hdf5.rows(group, "actions", where)
    if len(actions) != states:
        account.guessed(
            "time of the actions",
            f"{len(actions)} rows for {states} states: taken from the first on",
        )
    index = np.minimum(np.arange(length), max(0, len(actions) - 1))
    return actions[index] if len(actions) else np.zeros((length, 0))


def _opening(group: Any, joints: F64, where: str, account: Account) -> F64:
    """Return (T, 1) 0 closed … 1 open, from the joint that RoboLab's noisy ``gripper_pos`` follows."""
    none = np.zeros((len(joints), 0))
    if group.get("obs/gripper_pos") is None or not joints.shape[1]:
        return none
    noisy = hdf5.rows(group["obs"], "gripper_pos", f"{where}/obs")[:, 0]
    rows = min(len(noisy), len(joints))
    closed = np.clip(joints[:rows] / CLOSED, 0, 1)
    off = np.abs(closed - noisy[:rows, None]).mean(axis=0)
    best = int(np.argmin(off))
    if off[best] > 0.1:  # its noise has a standard deviation of 0.05
        return none
    account.recomputed(
        "opening of the gripper",
        f"from joint {best}, which the noisy observation gripper_pos follows",
    )
    return 1 - np.clip(joints[:, best : best + 1] / CLOSED, 0, 1)


def rows_with_first(group: Any, first: Any, key: str, where: str, width: int | None = None) -> F64:
    """Return (T, k) of a dataset, after its row in the initial state where there is one."""
    values = hdf5.rows(group, key, where, width)
    if first is None:
        return values
    return np.vstack(
        [hdf5.rows(first, key, f"{where}, initial_state", values.shape[1])[:1], values]
    )
