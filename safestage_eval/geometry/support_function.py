"""Support functions: how far a convex geom reaches in a direction, and where.

Schneider & Eberly, "Geometric tools for computer graphics", ch. 11; the ellipsoid's follows from
mapping it to the unit ball.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

from .shape import BOX, CYLINDER, ELLIPSOID, HULL, PLANE, SEGMENT, Packed

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Pair(NamedTuple):
    """Two geoms, neither a plane unless said otherwise, and how they lie to each other.

    Attributes:
        A, B: the bodies' geoms.
        a, b: which geom of each.
        R, p: (3, 3) and (3,) m, pose of geom b in the axes of geom a.
        up: (3,) zero, or a unit vector in the axes of a along which both are flattened.
    """

    A: Packed
    a: int
    B: Packed
    b: int
    R: F64
    p: F64
    up: F64


ANCHORS = 24
"""Vertices of a large hull that are looked at before the search along its edges."""


@kernel
def _top(
    vertices: F64, ring: I64, beside: I64, first: int, count: int, x: float, y: float, z: float
) -> int:
    """The row of a hull's vertex that is farthest along (x, y, z)."""
    best, row = -np.inf, first
    edges = ring[first + 1] > ring[first]
    # from the best of a few, uphill along edges: on a hull, what no neighbour tops is the top
    for i in range(first, first + count, count // ANCHORS + 1 if edges else 1):
        v = vertices[i, 0] * x + vertices[i, 1] * y + vertices[i, 2] * z
        if v > best:
            best, row = v, i
    while edges:
        here = row
        for k in range(ring[here], ring[here + 1]):
            i = beside[k]
            v = vertices[i, 0] * x + vertices[i, 1] * y + vertices[i, 2] * z
            if v > best:
                best, row = v, i
        if row == here:
            break
    return row


@helper
def support_point(geoms: Packed, g: int, x: float, y: float, z: float, out: F64) -> None:
    """Write into ``out`` (3,) the point of geom g's core that is farthest along (x, y, z).

    Direction and point in the geom's own axes, from its centre; the margin is left out. Not for
    planes. Where several points are equally far, one of them.
    """
    kind = geoms.kind[g]
    if kind == HULL:
        row = _top(
            geoms.vertices, geoms.ring, geoms.beside, geoms.first[g], geoms.points[g], x, y, z
        )
        out[0], out[1], out[2] = (
            geoms.vertices[row, 0],
            geoms.vertices[row, 1],
            geoms.vertices[row, 2],
        )
        return
    a, b, c = geoms.size[g, 0], geoms.size[g, 1], geoms.size[g, 2]
    if kind == BOX:
        out[0] = a if x >= 0 else -a
        out[1] = b if y >= 0 else -b
        out[2] = c if z >= 0 else -c
    elif kind == CYLINDER:
        radial = np.sqrt(x * x + y * y)
        out[0] = a * (x / radial) if radial > 0 else a
        out[1] = a * (y / radial) if radial > 0 else 0.0
        out[2] = c if z >= 0 else -c
    elif kind == ELLIPSOID:
        norm = np.sqrt(a * a * x * x + b * b * y * y + c * c * z * z)
        scale = 1.0 / norm if norm > 0 else 0.0
        out[0], out[1], out[2] = a * a * x * scale, b * b * y * scale, c * c * z * scale
    else:
        out[0], out[1] = 0.0, 0.0
        out[2] = (c if z >= 0 else -c) if kind == SEGMENT else 0.0


@helper
def support_value(geoms: Packed, g: int, x: float, y: float, z: float, point: F64) -> float:
    """How far geom g, margin included, reaches along the *unit* direction (x, y, z), m.

    Direction in the geom's own axes, distance from its centre; ``point`` (3,) is scratch. A plane
    reaches 0 along its normal and infinitely far in any other direction.
    """
    if geoms.kind[g] == PLANE:
        return 0.0 if z > 1.0 - 1e-12 else np.inf
    support_point(geoms, g, x, y, z, point)
    value: float = point[0] * x + point[1] * y + point[2] * z + geoms.margin[g]
    return value


@helper
def support_pair(pair: Pair, x: float, y: float, z: float, at_a: F64, at_b: F64) -> None:
    """Write the points of a and of b that are farthest along (x, y, z) and along its opposite.

    The direction is in the axes of a, each point (3,) in those of its own geom.
    """
    R = pair.R
    support_point(pair.A, pair.a, x, y, z, at_a)
    support_point(
        pair.B,
        pair.b,
        -(R[0, 0] * x + R[1, 0] * y + R[2, 0] * z),
        -(R[0, 1] * x + R[1, 1] * y + R[2, 1] * z),
        -(R[0, 2] * x + R[1, 2] * y + R[2, 2] * z),
        at_b,
    )


@helper
def difference(pair: Pair, at_a: F64, at_b: F64, out: F64) -> None:
    """Write the point of A − B that two points (3,) make, each in its geom's axes, into ``out``."""
    R, p = pair.R, pair.p
    for i in range(3):
        out[i] = at_a[i] - (R[i, 0] * at_b[0] + R[i, 1] * at_b[1] + R[i, 2] * at_b[2] + p[i])
