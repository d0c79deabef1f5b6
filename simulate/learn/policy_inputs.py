"""Inputs of networks, and the meaning of their answers: arrays in the frame of the arm's base."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulate.arm.kinematics import ArmAlone

from .scene_slots import SLOT, SLOTS

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

ARM = 10
"""Position of the TCP (m), first two columns of its rotation, opening of the gripper."""
OBJECT = 10
"""Per slot: position (m), first two columns of the rotation, 1 where there is an object."""
ANSWER = 10
"""Per control step: position of the TCP (m), first two columns of its rotation, above 0 to close.

Two columns of a rotation are continuous where quaternions and angles jump (Zhou et al. 2019, "On the
continuity of rotation representations in neural networks")."""


def arm_rows(arm: ArmAlone, joints: NDArray[np.floating], last: NDArray[np.floating]) -> F32:
    """(N, 10) the TCP's poses at joint positions (N, 7) rad, and (N,) of the gripper."""
    rows = np.empty((len(joints), ARM), np.float32)
    for row, q in zip(rows, joints, strict=True):
        position, rotation = arm.tcp(np.asarray(q, np.float64))
        row[:3], row[3:9] = position, rotation[:, :2].T.ravel()
    rows[:, 9] = last
    return rows


def object_rows(scene: F32) -> F32:
    """(N, SLOTS, 10) from rows of ``scene_slots`` (N, SLOTS × 8)."""
    slots = scene.reshape(len(scene), SLOTS, len(SLOT))
    w, x, y, z = np.moveaxis(slots[..., 3:7], -1, 0)
    columns = np.stack(
        [
            w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y),
            2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x),
        ],
        -1,
    )  # fmt: skip
    return np.concatenate([slots[..., :3], columns, slots[..., 7:]], -1).astype(np.float32)


def rotation_of(columns: NDArray[np.floating]) -> F64:
    """(3, 3) the rotation nearest to two columns (6,), by Gram and Schmidt."""
    first, second = np.asarray(columns, np.float64).reshape(2, 3)
    x = first / max(float(np.linalg.norm(first)), 1e-9)
    y = second - (x @ second) * x
    y /= max(float(np.linalg.norm(y)), 1e-9)
    return np.column_stack([x, y, np.cross(x, y)])
