"""Kernels over many orientations: a vector turned by each, the angle between each two."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

F64 = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]]

QUARTER = math.sin(math.pi / 4)


@helper
def _norm(orientation: Numbers, t: int) -> float:
    """Of the quaternion in row t; NaN where it is 0 or not finite."""
    square = 0.0
    for i in range(4):
        part = np.float64(orientation[t, i])
        square += part * part
    return math.sqrt(square) if 0.0 < square < math.inf else math.nan


@kernel
def turn_all(orientation: Numbers, vector: F64, out: F64) -> bool:
    """Add a vector (3,), turned by each quaternion (T, 4), to ``out`` (T, 3).

    R v with R as ``pose.matrix`` has it. False where a quaternion has norm 0 or is not finite.
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
def point_speeds(
    linear: Numbers, angular: Numbers, orientation: Numbers, point: F64, out: F64
) -> bool:
    """Write v + ω × (R p) (T, 3) m/s: the velocity of a point (3,) given in the local frame.

    ``linear`` and ``angular`` (T, 3) are those of the local frame's origin, world, in m/s and
    rad/s, ``orientation`` is (T, 4). False where a quaternion has norm 0 or is not finite.
    """
    out[:] = 0.0
    if not turn_all(orientation, point, out):
        return False
    for t in range(out.shape[0]):
        x, y, z = out[t, 0], out[t, 1], out[t, 2]
        u, v, w = np.float64(angular[t, 0]), np.float64(angular[t, 1]), np.float64(angular[t, 2])
        out[t, 0] = np.float64(linear[t, 0]) + (v * z - w * y)
        out[t, 1] = np.float64(linear[t, 1]) + (w * x - u * z)
        out[t, 2] = np.float64(linear[t, 2]) + (u * y - v * x)
    return True


@kernel
def angles(first: Numbers, second: Numbers, out: F64) -> bool:
    """Write the angles (T,) rad between quaternions (T, 4) and others, (T, 4) or (1, 4).

    As ``pose.angle``. False where a quaternion has norm 0 or is not finite.
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
        out[t] = 4.0 * math.asin(min(math.sqrt(min(minus, plus)) / 2.0, QUARTER))
    return True
