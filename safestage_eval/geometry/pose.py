"""Rotations and rigid poses. Quaternions are wxyz; inputs need not be exactly normalised.

All functions broadcast over leading axes and compute in float64, whatever they are given.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]

_QUARTER = math.sin(math.pi / 4)


def unit(orientation: ArrayLike) -> F64:
    """(…, 4) the quaternions scaled to norm 1. Raises ValueError where the norm is 0 or not finite."""
    q = np.asarray(orientation, np.float64)
    norm = np.sqrt(np.einsum("...i,...i->...", q, q))[..., None]  # faster than a short sum
    if not (np.isfinite(norm).all() and (norm > 0).all()):
        raise ValueError("a quaternion has norm 0 or is not finite")
    return np.asarray(q / norm)


def matrix(orientation: ArrayLike) -> F64:
    """(…, 3, 3) rotation matrices of quaternions (…, 4): columns are the turned axes."""
    q = unit(orientation)
    w, x, y, z = (q[..., i] for i in range(4))
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 0, 1] = 2 * (x * y - z * w)
    out[..., 0, 2] = 2 * (x * z + y * w)
    out[..., 1, 0] = 2 * (x * y + z * w)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 1, 2] = 2 * (y * z - x * w)
    out[..., 2, 0] = 2 * (x * z - y * w)
    out[..., 2, 1] = 2 * (y * z + x * w)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def product(first: ArrayLike, second: ArrayLike) -> F64:
    """(…, 4) Hamilton product: the rotation ``second`` followed by ``first``."""
    p, q = np.asarray(first, np.float64), np.asarray(second, np.float64)
    w = p[..., 0] * q[..., 0] - (p[..., 1:] * q[..., 1:]).sum(-1)
    v = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + np.cross(p[..., 1:], q[..., 1:])
    return np.concatenate([w[..., None], v], -1)


def conjugate(orientation: ArrayLike) -> F64:
    """(…, 4) the opposite rotation of a unit quaternion."""
    return np.asarray(np.asarray(orientation, np.float64) * np.array([1.0, -1.0, -1.0, -1.0]))


def rotate(orientation: ArrayLike, vector: ArrayLike) -> F64:
    """(…, 3) vectors (…, 3) turned by quaternions (…, 4).

    Raises ValueError where a quaternion has norm 0 or is not finite.
    """
    if np.ndim(vector) == 1:
        return np.asarray(
            np.einsum("...ij,j->...i", matrix(orientation), np.asarray(vector, np.float64))
        )
    return np.asarray((matrix(orientation) @ np.asarray(vector, np.float64)[..., None])[..., 0])


def transform(position: ArrayLike, orientation: ArrayLike, point: ArrayLike) -> F64:
    """(…, 3) points (…, 3), given in the local frame, in the parent frame of the pose (m)."""
    return rotate(orientation, point) + np.asarray(position, np.float64)


def point_velocity(
    linear: ArrayLike, angular: ArrayLike, orientation: ArrayLike, point: ArrayLike
) -> F64:
    """(T, 3) m/s, world: velocity of a point (3,) given in the local frames of T poses.

    v + ω × (R p), of the frames' velocities (T, 3) in m/s and rad/s, world. Raises ValueError where
    a quaternion has norm 0 or is not finite.
    """
    lever = rotate(orientation, point)
    return np.asarray(
        np.asarray(linear, np.float64) + np.cross(np.asarray(angular, np.float64), lever)
    )


def inverse_transform(position: ArrayLike, orientation: ArrayLike, point: ArrayLike) -> F64:
    """(…, 3) points (…, 3), given in the pose's parent frame, in its local frame (m)."""
    offset = np.asarray(point, np.float64) - np.asarray(position, np.float64)
    return rotate(conjugate(orientation), offset)


def compose(
    position: ArrayLike, orientation: ArrayLike, inner: ArrayLike, inner_orientation: ArrayLike
) -> tuple[F64, F64]:
    """The pose ``inner`` (given in the local frame of the first pose) in that pose's parent frame."""
    return transform(position, orientation, inner), product(
        unit(orientation), unit(inner_orientation)
    )


def relative(
    position_a: ArrayLike, orientation_a: ArrayLike, position_b: ArrayLike, orientation_b: ArrayLike
) -> tuple[F64, F64]:
    """Pose of b in the frame of a: position (…, 3) m, orientation (…, 4)."""
    return (
        inverse_transform(position_a, orientation_a, position_b),
        product(conjugate(unit(orientation_a)), unit(orientation_b)),
    )


def angle(orientation_a: ArrayLike, orientation_b: ArrayLike) -> F64:
    """(…,) geodesic angle in radians, 0…π, between two orientations (…, 4).

    Of ‖q∓q′‖ = 2 sin(θ/4) rather than from the dot product's arc cosine: equal quaternions give
    exactly 0, and small angles keep their digits (Huynh 2009, "Metrics for 3D rotations").
    """
    p, q = unit(orientation_a), unit(orientation_b)
    minus, plus = (np.einsum("...i,...i->...", x, x) for x in (p - q, p + q))
    half = np.minimum(np.sqrt(np.minimum(minus, plus)) / 2, _QUARTER)
    return np.asarray(4 * np.arcsin(half))


def mean_orientation(orientation: ArrayLike) -> F64:
    """(4,) the orientation with the least summed squared chord to (T, 4) orientations.

    Markley et al. 2007, "Averaging quaternions": the leading eigenvector of Σ q qᵀ.
    """
    q = unit(orientation)
    if (q == q[0]).all():
        return np.array(q[0])
    values, vectors = np.linalg.eigh(q.T @ q)
    mean = vectors[:, np.argmax(values)]
    return np.asarray(mean if mean @ q[0] >= 0 else -mean, np.float64)
