"""A recorded rollout as a policy saw it: one row of state and command per control step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from simulate.world.world import FRAMES_PER_ACTION

from .disturbance import disturbed
from .scene_slots import filled, slot_order

STATE_NAMES = (*(f"joint_{i}" for i in range(1, 8)), "gripper_opening")
"""Seven measured joint positions (rad), and 0 closed … 1 open."""
ACTION_NAMES = (*(f"joint_{i}" for i in range(1, 8)), "gripper_closed")
"""Seven commanded joint positions (rad), and 1 closes."""

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class ControlSteps:
    """A rollout at its control steps, up to its success.

    Attributes:
        state: (N, 8) see ``STATE_NAMES``.
        scene: (N, SLOTS × 8) see ``scene_slots``.
        action: (N, 8) see ``ACTION_NAMES``.
        disturbed: (N,) where the command is not the demonstrator's own.
    """

    state: F32
    scene: F32
    action: F32
    disturbed: NDArray[np.bool_]

    def __len__(self) -> int:
        """N."""
        return len(self.state)


def control_rows(episode: Episode) -> NDArray[np.int64]:
    """Frames at which the policy was asked, up to the episode's success."""
    success = episode.header.success_time
    until = success if success is not None else float(episode.t[-1])
    rows = np.arange(0, len(episode), FRAMES_PER_ACTION)
    result: NDArray[np.int64] = rows[episode.t[rows] < until]
    return result


def control_steps(episode: Episode) -> ControlSteps:
    """The control steps of an episode recorded by ``safestage bench record``.

    A frame holds the state before its physics step, so each eighth one is what the policy was given.

    Raises InputError for an episode of another arm, or without poses of objects.
    """
    header, frames = episode.header, episode.frames
    where = f"episode {header.episode_id!r}"
    if frames.action.shape[1] != 8 or frames.gripper.shape[1] != 1:
        raise InputError(
            where, "has not the seven joints, the gripper and their commands of the DROID arm.",
            fix="record it with `safestage bench record`",
        )  # fmt: skip
    rows = control_rows(episode)
    names = [
        body.name
        for body in header.bodies
        if body.kind not in ("robot", "gripper") and body.name not in ("table", "floor")
    ]
    if not names or not len(rows):
        raise InputError(where, "has no objects, or no control steps, to learn from.")
    poses: dict[str, NDArray[np.float64]] = {}
    for name in names:
        track = episode.track(name)
        poses[name] = np.hstack([track.position[rows], track.orientation[rows]]).astype(np.float64)
    return ControlSteps(
        np.hstack([frames.joint_position[rows, :7], frames.gripper[rows]]).astype(np.float32),
        filled(poses, slot_order(names, header.roles)),
        frames.action[rows].astype(np.float32),
        disturbed(header.notes, len(rows)),
    )
