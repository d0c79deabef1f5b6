"""From which frame on bodies lie otherwise on each other: the kernel behind ``Arrangement``."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, helper, kernel

from .statics import ARM, LOST

Bool = NDArray[np.bool_]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

SHIFTED = LOST * ARM
"""m: a contact that moved by less changes no torque by more than the balance leaves open."""
TURNED = LOST
"""rad: likewise of a normal, a body, or one body as seen from another."""

LAYOUT = 15
"""Numbers that tell how contact points lie: mean from both centres, mean normal, spread."""


class Layout(NamedTuple):
    """K bodies and P pairs of them that touch, over T frames.

    Attributes:
        position, orientation: (K, T, 3) m and (K, T, 4), as they are stored.
        centre: (K, T, 3) m, centres of mass.
        pair: (P, 2) the bodies of each pair.
        start: (P, T + 1) the rows of frame t are start[t] … start[t + 1].
        point, normal: (N, 3) m and unit, contact points by pair and frame.
    """

    position: F32
    orientation: F32
    centre: F64
    pair: I64
    start: I64
    point: F64
    normal: F64


@allocating
def stays_for(
    position: F32, orientation: F32, joined: Bool, loose: Bool, frame: int, earliest: int,
    shift: float, arc: float,
) -> tuple[int, int]:  # fmt: skip
    """From when and until when what hangs together at a frame stays as it is there.

    Args:
        position: (K, T, 3) m of each body.
        orientation: (K, T, 4).
        joined: (K, T) where each hangs together with the others.
        loose: (T,) where nobody touches what hangs together.
        frame: all that hang together at it must stay, and what joins them later must come to them
            as it was there already.
        earliest: no frame before that is looked at.
        shift: m, in each coordinate.
        arc: of each coordinate of a quaternion.
    """
    reach = np.array([frame, frame])
    come = np.empty(len(position), np.bool_)
    for way in range(2):
        come[:] = False
        t, still = frame, True
        while still and earliest <= t < len(loose):
            still = loose[t]
            for b in range(len(position)):
                own = joined[b, frame]
                if still and (own or (joined[b, t] and not come[b])):
                    come[b] = True
                    still = _near(position[b], frame, t, shift) and _near(
                        orientation[b], frame, t, arc
                    )
            if still:
                reach[way] = t
            t += 1 if way else -1
    return reach[0], reach[1] + 1


@allocating
def stretch_starts(layout: Layout, frames: I64, part: NDArray[np.int32], first: I64) -> None:
    """Write for each of the frames (N,) the frame that its stretch begins with.

    A stretch ends where the ``part`` (N,) of the frames does, or where bodies turned, or moved
    against each other, and contact points or normals moved with them: points alone jump about under
    what stands still, and bodies alone slide along what is flat.
    """
    bodies, pairs = len(layout.position), len(layout.pair)
    stays, touching = np.empty(bodies, np.bool_), np.empty(pairs, np.bool_)
    before, after = np.empty((2, LAYOUT)), np.empty((2, 7))
    begin = -1
    for n in range(len(frames)):
        t = frames[n]
        if n == 0 or part[n] != part[n - 1]:
            begin = t
            for p in range(pairs):
                touching[p] = layout.start[p, t] < layout.start[p, t + 1]
        elif _moved(layout, touching, begin, t, stays, after) and _rearranged(
            layout, touching, begin, t, before
        ):
            begin = t
        first[n] = begin


@kernel
def _moved(layout: Layout, touching: Bool, s: int, t: int, stays: Bool, poses: F64) -> bool:
    """Some body leans otherwise at t than at s, or lies otherwise on another."""
    for b in range(len(stays)):
        stays[b] = _near(layout.position[b], s, t, SHIFTED / 4) and _near(
            layout.orientation[b], s, t, TURNED / 40
        )
    for p in range(len(layout.pair)):
        i, j = layout.pair[p, 0], layout.pair[p, 1]
        if not touching[p] or (stays[i] and stays[j]):
            continue
        _relative(layout, i, j, s, poses[0])
        _relative(layout, i, j, t, poses[1])
        square = 0.0
        for a in range(3):
            square += (poses[1, a] - poses[0, a]) ** 2
        if math.sqrt(square) > SHIFTED or _angle(poses[0], poses[1]) > TURNED:
            return True
        for b in (i, j):
            q = layout.orientation[b]
            if not stays[b] and _leans(q, s, t) > TURNED:
                return True
    return False


@kernel
def _near(values: F32, s: int, t: int, room: float) -> bool:
    """Whether every component is within ``room`` of its earlier value."""
    near = True
    for i in range(values.shape[1]):
        near &= abs(values[t, i] - values[s, i]) < np.float32(room)
    return near


@helper
def _unit(orientation: F32, t: int) -> tuple[float, float, float, float]:
    w, x = np.float64(orientation[t, 0]), np.float64(orientation[t, 1])
    y, z = np.float64(orientation[t, 2]), np.float64(orientation[t, 3])
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size


@kernel
def _relative(layout: Layout, i: int, j: int, t: int, out: F64) -> None:
    """Pose of body j in the frame of body i: position (m) and quaternion (7,)."""
    w, x, y, z = _unit(layout.orientation[i], t)
    d, e, f, g = _unit(layout.orientation[j], t)
    a = np.float64(layout.position[j, t, 0]) - np.float64(layout.position[i, t, 0])
    b = np.float64(layout.position[j, t, 1]) - np.float64(layout.position[i, t, 1])
    c = np.float64(layout.position[j, t, 2]) - np.float64(layout.position[i, t, 2])
    out[0] = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y + z * w) * b + 2 * (x * z - y * w) * c
    out[1] = 2 * (x * y - z * w) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z + x * w) * c
    out[2] = 2 * (x * z + y * w) * a + 2 * (y * z - x * w) * b + (1 - 2 * (x * x + y * y)) * c
    out[3] = w * d + x * e + y * f + z * g
    out[4] = w * e - x * d - y * g + z * f
    out[5] = w * f - y * d - z * e + x * g
    out[6] = w * g - z * d - x * f + y * e


@helper
def _angle(first: F64, second: F64) -> float:
    """rad, between two quaternions, the last of seven numbers: as ``pose.angle``."""
    minus, plus = 0.0, 0.0
    for i in range(3, 7):
        minus += (first[i] - second[i]) ** 2
        plus += (first[i] + second[i]) ** 2
    return 4 * math.asin(min(math.sqrt(min(minus, plus)) / 2, math.sqrt(0.5)))


@kernel
def _leans(orientation: F32, s: int, t: int) -> float:
    """By how much the vertical, as the body sees it, differs between two frames."""
    w, x, y, z = _unit(orientation, s)
    d, e, f, g = _unit(orientation, t)
    a = 2 * (x * z - y * w) - 2 * (e * g - f * d)
    b = 2 * (y * z + x * w) - 2 * (f * g + e * d)
    c = 2 * (e * e + f * f) - 2 * (x * x + y * y)
    return math.sqrt(a * a + b * b + c * c)


@kernel
def _rearranged(layout: Layout, touching: Bool, s: int, t: int, room: F64) -> bool:
    """Contact points or normals of some pair are elsewhere at t than at s."""
    for p in range(len(touching)):
        if touching[p]:
            _lay_out(layout, p, s, room[0])
            _lay_out(layout, p, t, room[1])
            for k in range(LAYOUT):
                if abs(room[1, k] - room[0, k]) > 1.0:
                    return True
    return False


@kernel
def _lay_out(layout: Layout, p: int, t: int, out: F64) -> None:
    """How a pair's contact points lie: ``LAYOUT``, each in units of what makes a difference."""
    begin, end = layout.start[p, t], layout.start[p, t + 1]
    many = max(end - begin, 1)
    out[:] = 0.0
    for n in range(begin, end):
        for a in range(3):
            out[a] += layout.point[n, a]
            out[6 + a] += layout.normal[n, a]
    x, y, z = out[0] / many, out[1] / many, out[2] / many
    for n in range(begin, end):
        a, b, c = layout.point[n, 0] - x, layout.point[n, 1] - y, layout.point[n, 2] - z
        out[9] += a * a
        out[10] += b * b
        out[11] += c * c
        out[12] += a * b
        out[13] += b * c
        out[14] += c * a
    size = math.sqrt((out[9] + out[10] + out[11]) / many)
    for k in range(9, 15):
        out[k] /= many * SHIFTED * max(size, SHIFTED)
    for a in range(3):
        out[6 + a] /= many * TURNED
        middle = out[a] / many
        for side in range(2):
            centre = layout.centre[layout.pair[p, side], t, a]
            out[3 * side + a] = (middle - centre) / SHIFTED
