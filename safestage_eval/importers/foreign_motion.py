"""Poses and twists of a foreign convention, in ours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Track
from safestage_eval.errors import TraceError
from safestage_eval.geometry.pose import rotate

from .importer import QuaternionOrder

F64 = NDArray[np.float64]

NORM = 1e-2
"""A quaternion whose norm is further from 1 than this is none."""


def to_wxyz(quaternions: F64, order: QuaternionOrder, where: str) -> F64:
    """Return (T, 4) wxyz of unit norm.

    Raises:
        TraceError: they are not finite, or far from unit norm.
    """
    norm = np.linalg.norm(quaternions, axis=1, keepdims=True)
    off = np.flatnonzero(~(np.abs(norm[:, 0] - 1) < NORM))
    if len(off):
        raise TraceError(
            where,
            f"orientation at row {off[0]} has norm {norm[off[0], 0]:.4g}.",
            "unit quaternions",
        )
    unit: F64 = quaternions / norm
    return unit if order == "wxyz" else unit[:, [3, 0, 1, 2]]


def make_track(position: F64, orientation: F64, linear: F64 | None, angular: F64 | None) -> Track:
    """Make a track of (T, 3) m, (T, 4) wxyz, (T, 3) m/s of the body frame's origin, (T, 3) rad/s; all world.

    Without velocities zeros are stored, and rules derive them from the poses.
    """
    none = np.zeros((len(position), 3), np.float32)
    return Track(
        position.astype(np.float32),
        orientation.astype(np.float32),
        none if linear is None else linear.astype(np.float32),
        none if angular is None else angular.astype(np.float32),
    )


def at_origin(linear: F64, angular: F64, orientation: F64, com: tuple[float, ...]) -> F64:
    """Return the (T, 3) velocity in m/s of the body frame's origin, from that of the centre of mass.

    v_o = v_c − ω × (R c); ``com`` (3,) m in the body frame. (Rigid body kinematics.)
    """
    offset = np.asarray(com, np.float64)
    return linear - np.cross(angular, rotate(orientation, offset)) if offset.any() else linear


def fixed_if_still(body: Body, motion: Track) -> tuple[Body, Track]:
    """Return body and track; a fixture or robot that never moves, to the bit, as a fixed body with a single row."""
    still = (motion.position == motion.position[:1]).all() and (
        motion.orientation == motion.orientation[:1]
    ).all()
    if body.kind not in ("fixture", "robot") or not still or not body.movable:
        return body, motion
    none = np.zeros((1, 3), np.float32)
    return body.model_copy(update={"movable": False}), Track(
        motion.position[:1], motion.orientation[:1], none, none
    )
