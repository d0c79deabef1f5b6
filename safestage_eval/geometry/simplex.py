"""The point of a simplex that is nearest to the origin.

Ericson 2005, "Real-time collision detection", ch. 5 and 9: by areas and volumes of sub-simplices,
here from cross products of edges, which keep their digits for needles and slivers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

F64 = NDArray[np.float64]


@helper
def _segment(points: F64, i: int, j: int, weight: F64) -> float:
    """Squared distance from the origin to a segment; barycentric weights into ``weight`` (4,)."""
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    dx, dy, dz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
    length = dx * dx + dy * dy + dz * dz
    along = -(ax * dx + ay * dy + az * dz)
    share = 0.0
    if along > 0.0 and length > 0.0:
        share = min(along / length, 1.0)
    for c in range(4):
        weight[c] = 0.0
    weight[i] = 1.0 - share
    weight[j] = share
    x, y, z = ax + share * dx, ay + share * dy, az + share * dz
    return float(x * x + y * y + z * z)


@kernel
def _triangle(points: F64, i: int, j: int, k: int, weight: F64, other: F64) -> float:
    """Like ``_segment``, for a triangle; ``other`` (4,) is scratch."""
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    bx, by, bz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
    cx, cy, cz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    square = nx * nx + ny * ny + nz * nz
    if square > 1e-24 * (bx * bx + by * by + bz * bz) * (cx * cx + cy * cy + cz * cz):
        # areas of the triangles that the origin's projection makes with two of the edges
        ux, uy, uz = ay * cz - az * cy, az * cx - ax * cz, ax * cy - ay * cx
        vx, vy, vz = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
        beta = -(ux * nx + uy * ny + uz * nz) / square
        gamma = -(vx * nx + vy * ny + vz * nz) / square
        alpha = 1.0 - beta - gamma
        if alpha >= 0.0 and beta >= 0.0 and gamma >= 0.0:
            for c in range(4):
                weight[c] = 0.0
            weight[i], weight[j], weight[k] = alpha, beta, gamma
            height = ax * nx + ay * ny + az * nz
            return float(height * height / square)
    best = _segment(points, i, j, weight)
    for end in (i, j):
        d = _segment(points, end, k, other)
        if d < best:
            best = d
            for c in range(4):
                weight[c] = other[c]
    return best


@helper
def _volume(points: F64, i: int, j: int, k: int) -> float:
    """Six times the signed volume of the origin and three points."""
    return float(
        points[i, 0] * (points[j, 1] * points[k, 2] - points[j, 2] * points[k, 1])
        - points[i, 1] * (points[j, 0] * points[k, 2] - points[j, 2] * points[k, 0])
        + points[i, 2] * (points[j, 0] * points[k, 1] - points[j, 1] * points[k, 0])
    )


@helper
def _tetrahedron(points: F64, weights: F64) -> float:
    """Like ``_segment``, for all four points; weights into the first row of ``weights`` (4, 4).

    0 with four positive weights when the origin is inside.
    """
    weight, face, share = weights[0], weights[1], weights[3]
    total, size = 0.0, 0.0
    for skip in range(4):
        i, j, k = _others(skip)
        volume = _volume(points, i, j, k)
        share[skip] = volume if skip % 2 == 0 else -volume
        total += share[skip]
        size += abs(volume)
    flat = not abs(total) > 1e-14 * size
    inside = not flat
    for skip in range(4):
        weight[skip] = share[skip] / total if not flat else 0.0
        inside = inside and weight[skip] > 0.0
        share[skip] = weight[skip]
    if inside:
        return 0.0
    best = np.inf
    for skip in range(4):
        if flat or share[skip] <= 0.0:  # the origin is beyond the face that leaves this one out
            i, j, k = _others(skip)
            d = _triangle(points, i, j, k, face, weights[2])
            if d < best:
                best = d
                for c in range(4):
                    weight[c] = face[c]
    return best


@helper
def _others(skip: int) -> tuple[int, int, int]:
    """The three of 0, 1, 2, 3 that are left."""
    return (1 if skip == 0 else 0), (2 if skip <= 1 else 1), (3 if skip <= 2 else 2)


@helper
def nearest_weights(points: F64, n: int, weights: F64) -> None:
    """Barycentric weights of the point nearest the origin of the simplex of the first n points.

    ``points`` (4, 3); the weights go into the first row of ``weights`` (4, 4), the rest is scratch.
    Points that the nearest one does not need get weight 0; four positive weights mean that the
    origin is inside.
    """
    if n == 1:
        weights[0, 0] = 1.0
    elif n == 2:
        _segment(points, n - 2, n - 1, weights[0])
    elif n == 3:
        _triangle(points, n - 3, n - 2, n - 1, weights[0], weights[1])
    else:
        _tetrahedron(points, weights)
