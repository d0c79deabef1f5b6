"""The box of a body from the corners of its bounding box in the world, over many frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Geom, Vec3
from safestage_eval.geometry.pose import conjugate, rotate, unit

F64 = NDArray[np.float64]

FRAMES = 400
"""Frames that are examined at most, spread over the episode."""
ALIGNED = 1.5e-3
"""m. Corners that fit a box along the body's own axes this well are taken for one."""


@dataclass(frozen=True)
class Fit:
    """A box in the body frame.

    Attributes:
        geom: the box.
        spread: m, the furthest that a corner of any frame is from the mean one: rounding, or a
            sign that corners and poses do not belong together.
    """

    geom: Geom
    spread: float


def to_metres(corners_mm: NDArray[np.integer]) -> F64:
    """Return (T, 8, 3) m from integer millimetres that were rounded toward zero.

    A number n ≠ 0 stands for n to n ± 1, so its middle is half a millimetre further out.
    """
    whole = np.asarray(corners_mm, np.float64)
    return (whole + 0.5 * np.sign(whole)) * 1e-3


def fit(corners: F64, position: F64, orientation: F64) -> Fit | None:
    """Fit a box to its corners; None if it has no volume.

    Args:
        corners: (T, 8, 3) m, world; corner i has the upper bound in x, y, z where bit 0, 1, 2 of i
            is set (USD's order).
        position: (T, 3) m, of the body.
        orientation: (T, 4) wxyz, body frame to world.
    """
    frames = np.unique(np.linspace(0, len(corners) - 1, min(len(corners), FRAMES)).astype(int))
    arm = corners[frames] - position[frames, None]
    back = np.repeat(conjugate(unit(orientation[frames])), 8, axis=0)
    local = rotate(back, arm.reshape(-1, 3)).reshape(-1, 8, 3)
    mean = local.mean(axis=0)
    spread = float(np.abs(local - mean).max())
    upper = np.array([[i >> axis & 1 for axis in range(3)] for i in range(8)], bool)
    edges = np.array([mean[up].mean(0) - mean[~up].mean(0) for up in upper.T])
    centre = mean.mean(axis=0)
    above = mean > centre
    if not (above.any(axis=0) & ~above.all(axis=0)).all():
        return None  # flat, or numbers so large that their differences are lost
    low, high = mean.min(axis=0), mean.max(axis=0)
    nearest = np.array([np.where(up, high, low) for up in above])
    if np.abs(nearest - mean).max() <= ALIGNED:
        half = np.array([(mean[above[:, k], k].mean() - mean[~above[:, k], k].mean()) / 2
                         for k in range(3)])  # fmt: skip
        turn = (1.0, 0.0, 0.0, 0.0)
    else:
        half = np.linalg.norm(edges, axis=1) / 2
        if not (half > 0).all():
            return None
        turn = _quaternion(edges.T / (2 * half))
    if not (half > 0).all():
        return None
    return Fit(
        Geom(kind="box", size=_floats(half), position=_floats(centre), orientation=turn), spread
    )


def _quaternion(axes: F64) -> tuple[float, float, float, float]:
    """Wxyz of the rotation nearest to a (3, 3) matrix of columns."""
    from scipy.spatial.transform import Rotation

    if np.linalg.det(axes) < 0:  # a mirrored box is the same box
        axes = axes * np.array([1.0, 1.0, -1.0])
    u, _, v = np.linalg.svd(axes)
    turn = u @ v
    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    return float(w), float(x), float(y), float(z)


def _floats(values: F64) -> Vec3:
    x, y, z = (float(v) for v in values)
    return x, y, z
