"""Which bodies of a group start to move, given where they touch: equilibrium with dry friction.

Forces within the friction cones, equal and opposite on both bodies, are chosen such that what stays
unbalanced moves all bodies together as little as can be (Gauss's principle of least constraint;
``cones.balance``). If some forces balance all bodies, those are found and nothing moves: whether they
exist is the linear program of Baraff 1991, "Coping with friction for non-penetrating rigid body
simulation". If not, the motion is the only one of least constraint, and tells which bodies fall. A body's
motion is the root of the mean square acceleration of its mass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

from .cones import CONE_SIDES, COS, SIN, Cones

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

LOST = 0.02
"""Share of g: what starts to move by less is kept in its place by what no recording tells."""
ARM = 0.05
"""m: the lever by which torques are compared with forces; radius of gyration where none is stated."""


class Bodies(NamedTuple):
    """B rigid bodies.

    Attributes:
        mass: (B,) kg.
        centre: (B, 3) m, centres of mass, world.
        inertia: (B, 3, 3) kg m², about the centre of mass, world axes.
    """

    mass: F64
    centre: F64
    inertia: F64


class Touches(NamedTuple):
    """C points in which they touch each other or the ground (−1).

    Attributes:
        first, second: (C,) bodies.
        position: (C, 3) m, world.
        normal: (C, 3) unit, from the first to the second.
        friction: (C,) sliding coefficients.
    """

    first: I64
    second: I64
    position: F64
    normal: F64
    friction: F64


@kernel
def spread(bodies: Bodies, touches: Touches, count: int, cones: Cones) -> None:
    """Fill in the cones of the first ``count`` contacts."""
    for b in range(bodies.mass.shape[0]):
        _whiten(bodies.inertia[b], cones.whiten[b])
    for c in range(count):
        cones.first[c], cones.second[c] = touches.first[c], touches.second[c]
        nx, ny, nz = touches.normal[c, 0], touches.normal[c, 1], touches.normal[c, 2]
        # u = n × x, or n × y where x is nearly n; v = n × u
        ux, uy, uz = (0.0, nz, -ny) if abs(nx) < 0.9 else (-nz, 0.0, nx)
        size = math.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / size, uy / size, uz / size
        vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        rough = touches.friction[c]
        _act(bodies, touches, cones, c, 0, nx, ny, nz)
        _act(bodies, touches, cones, c, 1, rough * ux, rough * uy, rough * uz)
        _act(bodies, touches, cones, c, 2, rough * vx, rough * vy, rough * vz)
        effect = cones.effect[c]
        nn, nu, nv = (
            _dot(effect[0], effect[0]),
            _dot(effect[0], effect[1]),
            _dot(effect[0], effect[2]),
        )
        uu, uv, vv = (
            _dot(effect[1], effect[1]),
            _dot(effect[1], effect[2]),
            _dot(effect[2], effect[2]),
        )
        for k in range(CONE_SIDES):
            x, y = COS[k], SIN[k]
            square = nn + 2 * (x * nu + y * nv + x * y * uv) + x * x * uu + y * y * vv
            cones.scale[c, k] = 1.0 / math.sqrt(square)


@helper
def _act(
    bodies: Bodies, touches: Touches, cones: Cones, c: int, axis: int, x: float, y: float, z: float
) -> None:
    """Compute what a contact force (x, y, z) does to its two bodies, with opposite signs."""
    for side in range(2):
        b, sign = (touches.second[c], 1.0) if side else (touches.first[c], -1.0)
        out = cones.effect[c, axis, side]
        for i in range(6):
            out[i] = 0.0
        if b < 0:
            continue
        rx = touches.position[c, 0] - bodies.centre[b, 0]
        ry = touches.position[c, 1] - bodies.centre[b, 1]
        rz = touches.position[c, 2] - bodies.centre[b, 2]
        one = sign / math.sqrt(bodies.mass[b])
        out[0], out[1], out[2] = one * x, one * y, one * z
        tx, ty, tz = sign * (ry * z - rz * y), sign * (rz * x - rx * z), sign * (rx * y - ry * x)
        for i in range(3):
            row = cones.whiten[b, i]
            out[3 + i] = row[0] * tx + row[1] * ty + row[2] * tz


@helper
def _dot(a: F64, b: F64) -> float:
    found = 0.0
    for side in range(2):
        for i in range(6):
            found += a[side, i] * b[side, i]
    return found


@kernel
def _whiten(inertia: F64, out: F64) -> None:
    """The inverse of the Cholesky factor (3, 3)."""
    a = math.sqrt(inertia[0, 0])
    b, d = inertia[1, 0] / a, inertia[2, 0] / a
    c = math.sqrt(inertia[1, 1] - b * b)
    e = (inertia[2, 1] - d * b) / c
    f = math.sqrt(inertia[2, 2] - d * d - e * e)
    out[0, 0], out[0, 1], out[0, 2] = 1.0 / a, 0.0, 0.0
    out[1, 0], out[1, 1], out[1, 2] = -b / (a * c), 1.0 / c, 0.0
    out[2, 0] = (b * e - c * d) / (a * c * f)
    out[2, 1], out[2, 2] = -e / (c * f), 1.0 / f


@kernel
def weigh(mass: F64, push: F64, which: Bool, weight: F64) -> None:
    """Set the wrenches that balance weights and push, (B, 6) in g times root of mass; 0 elsewhere."""
    weight[:] = 0.0
    for b in range(mass.shape[0]):
        if which[b]:
            heavy = math.sqrt(mass[b])
            weight[b, 0], weight[b, 1], weight[b, 2] = -heavy * push[0], -heavy * push[1], heavy


@kernel
def speeds(mass: F64, rest: F64, out: F64) -> None:
    """(B,) how strongly each body moves, in g, of what is left of its weight."""
    for b in range(mass.shape[0]):
        square = 0.0
        for i in range(6):
            square += rest[b, i] * rest[b, i]
        out[b] = math.sqrt(square / mass[b])
