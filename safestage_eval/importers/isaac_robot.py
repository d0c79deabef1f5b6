"""Joints, actions and gripper of a RoboLab or Isaac Lab demo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Joint, RobotFrames
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account

F64 = NDArray[np.float64]

CLOSED = np.pi / 4
"""rad, RoboLab's finger joint when the gripper is closed (robolab/robots/droid.py)."""


class RobotColumns:
    """The robot's recorded columns besides the poses of its bodies."""

    def __init__(self, group: Any, length: int, where: str, account: Account) -> None:
        """``group``: of the demo; ``length``: its frames; ``where``: for messages."""
        self._group, self._length = group, length
        self._where, self._account = where, account

    def read(self, states: Any, first: Any) -> tuple[RobotFrames, tuple[Joint, ...]]:
        """Columns and joints of all articulations, by name.

        Args:
            states: the group of that name.
            first: the group ``initial_state``, None if there is none.

        Raises:
            TraceError: an articulation has other frames than the bodies.
        """
        columns: dict[str, list[F64]] = {"joint_position": [], "joint_velocity": []}
        joints: list[Joint] = []
        for name in sorted(states.get("articulation", ())):
            before = None if first is None else first.get(f"articulation/{name}")
            for key, parts in columns.items():
                where = f"{self._where}/{name}"
                values = rows_with_first(states["articulation"][name], before, key, where)
                if len(values) != self._length:
                    raise TraceError(
                        f"{where}/{key}", f"{len(values)} frames, the bodies have {self._length}"
                    )
                parts.append(values)
            own = f"{name}_base" if name in ("robot", "gripper") else name
            joints += [
                Joint(name=f"{name}_{i}", kind="revolute", body=own)
                for i in range(columns["joint_position"][-1].shape[1])
            ]
        none = np.zeros((self._length, 0))
        position = np.hstack([none, *columns["joint_position"]])
        frames = RobotFrames(
            position.astype(np.float32),
            np.hstack([none, *columns["joint_velocity"]]).astype(np.float32),
            none.astype(np.float32),
            self._actions(self._length - (0 if first is None else 1)).astype(np.float32),
            self._opening(position).astype(np.float32),
        )
        return frames, tuple(joints)

    def _actions(self, states: int) -> F64:
        """(T, A): row i is in force from frame i on; the last one is kept."""
        if "actions" not in self._group:
            return np.zeros((self._length, 0))
        found = hdf5.rows(self._group, "actions", self._where)
        if len(found) != states:
            self._account.guessed(
                "time of the actions",
                f"{len(found)} rows for {states} states: taken from the first on",
            )
        index = np.minimum(np.arange(self._length), max(0, len(found) - 1))
        return found[index] if len(found) else np.zeros((self._length, 0))

    def _opening(self, joints: F64) -> F64:
        """(T, 1) 0 closed … 1 open, from the joint that RoboLab's noisy ``gripper_pos`` follows."""
        seen = self._group.get("obs/gripper_pos")
        if seen is None or not joints.shape[1]:
            return np.zeros((self._length, 0))
        noisy = hdf5.rows(self._group["obs"], "gripper_pos", f"{self._where}/obs")[:, 0]
        rows = min(len(noisy), self._length)
        closed = np.clip(joints[:rows] / CLOSED, 0, 1)
        off = np.abs(closed - noisy[:rows, None]).mean(axis=0)
        best = int(np.argmin(off))
        if off[best] > 0.1:  # its noise has a standard deviation of 0.05
            return np.zeros((self._length, 0))
        self._account.recomputed(
            "opening of the gripper",
            f"from joint {best}, which the noisy observation gripper_pos follows",
        )
        return 1 - np.clip(joints[:, best : best + 1] / CLOSED, 0, 1)


def rows_with_first(group: Any, first: Any, key: str, where: str, width: int | None = None) -> F64:
    """(T, k) of a dataset, after its row in the initial state where there is one."""
    values = hdf5.rows(group, key, where, width)
    if first is None:
        return values
    return np.vstack(
        [hdf5.rows(first, key, f"{where}, initial_state", values.shape[1])[:1], values]
    )
