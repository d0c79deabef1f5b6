"""Rotations and rigid poses. Quaternions are wxyz; inputs need not be exactly normalised.

All functions broadcast over leading axes and compute in float64, whatever they are given.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval._process.compiled import helper, kernel

from .arrays import as_numbers, owned

F64 = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]]

_QUARTER = math.sin(math.pi / 4)
_NO_TURN = "a quaternion has norm 0 or is not finite"


def unit(orientation: ArrayLike) -> F64:
    """(…, 4) the quaternions scaled to norm 1. Raises ValueError where the norm is 0 or not finite."""
    q = np.asarray(orientation, np.float64)
    norm = np.sqrt(np.einsum("...i,...i->...", q, q))[..., None]  # faster than a short sum
    if not (np.isfinite(norm).all() and (norm > 0).all()):
        raise ValueError(_NO_TURN)
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
    if np.ndim(orientation) == 2 and np.ndim(vector) == 1:
        q = as_numbers(orientation)
        out = np.zeros((len(q), 3))
        if not _turn_all(q, owned(vector), out):
            raise ValueError(_NO_TURN)
        return out
    return np.asarray((matrix(orientation) @ np.asarray(vector, np.float64)[..., None])[..., 0])


def transform(position: ArrayLike, orientation: ArrayLike, point: ArrayLike) -> F64:
    """(…, 3) points (…, 3), given in the local frame, in the parent frame of the pose (m)."""
    if np.ndim(position) == 2 and np.ndim(orientation) == 2 and np.ndim(point) == 1:
        out, q = owned(position), as_numbers(orientation)
        if len(out) == len(q):
            if not _turn_all(q, owned(point), out):
                raise ValueError(_NO_TURN)
            return out
    return rotate(orientation, point) + np.asarray(position, np.float64)


def point_velocity(
    linear: ArrayLike, angular: ArrayLike, orientation: ArrayLike, point: ArrayLike
) -> F64:
    """(T, 3) m/s, world: velocity of a point (3,) given in the local frames of T poses.

    v + ω × (R p), of the frames' velocities (T, 3) in m/s and rad/s, world. Raises ValueError where
    a quaternion has norm 0 or is not finite.
    """
    columns = [np.asarray(c) for c in (linear, angular, orientation)]
    if not all(c.dtype == np.float32 and c.flags.carray for c in columns):
        columns = [owned(c) for c in columns]
    v, omega, q = columns
    out = np.empty(v.shape)
    if not _point_velocities(v, omega, q, owned(point), out):
        raise ValueError(_NO_TURN)
    return out


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
    first, second = np.ndim(orientation_a), np.ndim(orientation_b)
    if first == 2 and second in (1, 2):
        p, q = as_numbers(orientation_a), np.atleast_2d(as_numbers(orientation_b))
        if len(q) in (1, len(p)):
            out = np.empty(len(p))
            if not _angles(p, q, out):
                raise ValueError(_NO_TURN)
            return out
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


@helper
def _norm(orientation: Numbers, t: int) -> float:
    """Norm of the quaternion in row t; NaN where it is 0 or not finite."""
    square = 0.0
    for i in range(4):
        part = np.float64(orientation[t, i])
        square += part * part
    return math.sqrt(square) if 0.0 < square < math.inf else math.nan


@kernel
def _turn_all(orientation: Numbers, vector: F64, out: F64) -> bool:
    """Add a vector (3,), turned by each quaternion (T, 4), to ``out`` (T, 3).

    R v with R as ``matrix`` has it. False where a quaternion has norm 0 or is not finite.
    """
    a, b, c = vector[0], vector[1], vector[2]
    for t in range(out.shape[0]):
        norm = _norm(orientation, t)
        if math.isnan(norm):
            return False
        w, x = np.float64(orientation[t, 0]) / norm, np.float64(orientation[t, 1]) / norm
        y, z = np.float64(orientation[t, 2]) / norm, np.float64(orientation[t, 3]) / norm
        out[t, 0] += (
            (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - z * w) * b + 2 * (x * z + y * w) * c
        )
        out[t, 1] += (
            2 * (x * y + z * w) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - x * w) * c
        )
        out[t, 2] += (
            2 * (x * z - y * w) * a + 2 * (y * z + x * w) * b + (1 - 2 * (x * x + y * y)) * c
        )
    return True


@kernel
def _point_velocities(
    linear: Numbers, angular: Numbers, orientation: Numbers, point: F64, out: F64
) -> bool:
    """Write v + ω × (R p) (T, 3) m/s: the velocity of a point (3,) given in the local frame.

    ``linear`` and ``angular`` (T, 3) are those of the local frame's origin, world, in m/s and
    rad/s, ``orientation`` is (T, 4). False where a quaternion has norm 0 or is not finite.
    """
    out[:] = 0.0
    if not _turn_all(orientation, point, out):
        return False
    for t in range(out.shape[0]):
        x, y, z = out[t, 0], out[t, 1], out[t, 2]
        u, v, w = np.float64(angular[t, 0]), np.float64(angular[t, 1]), np.float64(angular[t, 2])
        out[t, 0] = np.float64(linear[t, 0]) + (v * z - w * y)
        out[t, 1] = np.float64(linear[t, 1]) + (w * x - u * z)
        out[t, 2] = np.float64(linear[t, 2]) + (u * y - v * x)
    return True


@kernel
def _angles(first: Numbers, second: Numbers, out: F64) -> bool:
    """Write the angles (T,) rad between quaternions (T, 4) and others, (T, 4) or (1, 4).

    As ``angle``. False where a quaternion has norm 0 or is not finite.
    """
    last = second.shape[0] - 1
    for t in range(out.shape[0]):
        s = min(t, last)
        p, q = _norm(first, t), _norm(second, s)
        if math.isnan(p) or math.isnan(q):
            return False
        p, q, minus, plus = 1.0 / p, 1.0 / q, 0.0, 0.0
        for i in range(4):
            x, y = np.float64(first[t, i]) * p, np.float64(second[s, i]) * q
            minus += (x - y) * (x - y)
            plus += (x + y) * (x + y)
        out[t] = 4.0 * math.asin(min(math.sqrt(min(minus, plus)) / 2.0, _QUARTER))
    return True
