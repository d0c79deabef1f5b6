"""Kernels that compare poses with velocities, and contacts with poses and shapes, in one pass each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

from .scene_shapes import BOX, CAPSULE, CYLINDER, MESH, PLANE, SPHERE

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


@kernel
def compare_motion(
    t: F64,
    pose: F32,
    rate: F32,
    unseen: NDArray[np.bool_],
    longest: float,
    window: float,
    shake: float,
    constant: float,
    per_second: float,
    out: F64,
) -> None:
    """Motion of a body, by its poses and by its velocities.

    Args:
        t: (T,) s.
        pose: (T, 3) m or (T, 4) quaternions wxyz.
        rate: (T, 3) m/s or rad/s.
        unseen: (T,) frames to leave out, or (0,).
        longest: s; steps that take longer are left out.
        window: s over which motion is added up before it is compared.
        shake: m/s (rad/s) by which velocities may say more than poses in each window.
        constant: m (rad) by which one step may differ …
        per_second: m/s (rad/s) … and more of a long one.
        out: (5,) sums of squares over the windows, of what poses say, of what velocities say, and of
            the difference; by how much the worst step differs beyond what it may, and the frame
            behind it (-1: none does).
    """
    out[:3] = 0.0
    most, at = 0.0, -1.0
    dx = dy = dz = mx = my = mz = since = 0.0
    for i in range(len(t)):
        step = t[i] - t[i - 1] if i else np.inf
        whole = step <= longest
        if whole and len(unseen) and (unseen[i] or unseen[i - 1]):
            whole = False
        x = y = z = vx = vy = vz = 0.0
        if whole:
            vx = 0.5 * step * (np.float64(rate[i, 0]) + rate[i - 1, 0])
            vy = 0.5 * step * (np.float64(rate[i, 1]) + rate[i - 1, 1])
            vz = 0.5 * step * (np.float64(rate[i, 2]) + rate[i - 1, 2])
            if pose.shape[1] == 3:
                x = np.float64(pose[i, 0]) - pose[i - 1, 0]
                y = np.float64(pose[i, 1]) - pose[i - 1, 1]
                z = np.float64(pose[i, 2]) - pose[i - 1, 2]
            else:
                x, y, z = _turned(pose, i)
            off = np.sqrt((x - vx) ** 2 + (y - vy) ** 2 + (z - vz) ** 2)
            if off - constant - per_second * step > most:
                most, at = off - constant - per_second * step, float(i)
            if not off < np.inf:
                whole = False
        if whole:
            dx, dy, dz = dx + x, dy + y, dz + z
            mx, my, mz = mx + vx, my + vy, mz + vz
            since += step
        if not whole or since >= window or i == len(t) - 1:
            out[0] += dx * dx + dy * dy + dz * dz
            out[1] += mx * mx + my * my + mz * mz
            apart = np.sqrt((dx - mx) ** 2 + (dy - my) ** 2 + (dz - mz) ** 2)
            if mx * mx + my * my + mz * mz > dx * dx + dy * dy + dz * dz:
                apart = max(apart - shake * since, 0.0)
            out[2] += apart * apart
            dx = dy = dz = mx = my = mz = since = 0.0
    out[3], out[4] = most, at


@kernel
def longest_step(
    t: F64, position: F32, unseen: NDArray[np.bool_], longest: float, fastest: float, out: F64
) -> None:
    """``out`` (2,): by how much (m) a step is longer than at ``fastest`` m/s; the frame behind it."""
    out[0], out[1] = 0.0, -1.0
    for i in range(1, len(t)):
        step = t[i] - t[i - 1]
        if step > longest or (len(unseen) and (unseen[i] or unseen[i - 1])):
            continue
        x = np.float64(position[i, 0]) - position[i - 1, 0]
        y = np.float64(position[i, 1]) - position[i - 1, 1]
        z = np.float64(position[i, 2]) - position[i - 1, 2]
        over = np.sqrt(x * x + y * y + z * z) - fastest * step
        if over > out[0]:
            out[0], out[1] = over, float(i)


@helper
def _turned(q: F32, i: int) -> Any:
    """Rotation vector (rad, world) from one quaternion to the next, the shorter way round."""
    a, b, c, d = np.float64(q[i, 0]), np.float64(q[i, 1]), np.float64(q[i, 2]), np.float64(q[i, 3])
    e, f = np.float64(q[i - 1, 0]), -np.float64(q[i - 1, 1])
    g, h = -np.float64(q[i - 1, 2]), -np.float64(q[i - 1, 3])
    w = a * e - b * f - c * g - d * h
    x = a * f + b * e + c * h - d * g
    y = a * g - b * h + c * e + d * f
    z = a * h + b * g - c * f + d * e
    square = x * x + y * y + z * z
    if square < 1e-4 * w * w:  # the series of atan: as precise, in a third of the time
        r = square / (w * w)
        small = 2.0 / w * (1.0 - r * (1.0 / 3.0 - r * (1.0 / 5.0 - r / 7.0)))
        return x * small, y * small, z * small
    size = np.sqrt(square)
    angle = 2.0 * np.arctan2(size, abs(w))
    scale = (angle / size if size > 1e-12 else 2.0) * (1.0 if w >= 0 else -1.0)
    return x * scale, y * scale, z * scale


@kernel
def farthest_point(
    frame: I32,
    point: F32,
    position: F32,
    turn: F32,
    kind: I32,
    size: F64,
    place: F64,
    axes: F64,
    every: int,
    out: F64,
) -> None:
    """How far contact points lie from the surface of the nearest shape of one body.

    Args:
        frame: (N,) of each contact.
        point: (N, 3) m, world.
        position: (T, 3) m of the body, or one row of a fixed one.
        turn: (T, 4) wxyz, likewise.
        kind: (G,) codes of its shapes.
        size: (G, 3) m, as in ``BodyShapes``.
        place: (G, 3) m, in the body frame.
        axes: (G, 3, 3) in the body frame, as columns.
        every: only each so many contacts are looked at.
        out: (2,) m, the largest distance; and the row in which it is, -1 if none was looked at.
    """
    out[0], out[1] = 0.0, -1.0
    for n in range(0, len(frame), every):
        i = frame[n] if len(position) > 1 else 0
        w, a, b, c = turn[i, 0], turn[i, 1], turn[i, 2], turn[i, 3]
        x = np.float64(point[n, 0]) - position[i, 0]
        y = np.float64(point[n, 1]) - position[i, 1]
        z = np.float64(point[n, 2]) - position[i, 2]
        # into the body frame: p + 2 w (p × v) + 2 v × (v × p), v the quaternion's vector
        cx, cy, cz = b * z - c * y, c * x - a * z, a * y - b * x
        px = x - 2 * w * cx + 2 * (b * cz - c * cy)
        py = y - 2 * w * cy + 2 * (c * cx - a * cz)
        pz = z - 2 * w * cz + 2 * (a * cy - b * cx)
        if not abs(px) + abs(py) + abs(pz) < np.inf:
            continue
        least = np.inf
        for g in range(len(kind)):
            dx, dy, dz = px - place[g, 0], py - place[g, 1], pz - place[g, 2]
            lx = axes[g, 0, 0] * dx + axes[g, 1, 0] * dy + axes[g, 2, 0] * dz
            ly = axes[g, 0, 1] * dx + axes[g, 1, 1] * dy + axes[g, 2, 1] * dz
            lz = axes[g, 0, 2] * dx + axes[g, 1, 2] * dy + axes[g, 2, 2] * dz
            least = min(least, _surface(kind[g], size[g, 0], size[g, 1], size[g, 2], lx, ly, lz))
        if out[1] < 0 or least > out[0]:
            out[0], out[1] = least, n


@helper
def _surface(kind: int, a: float, b: float, c: float, x: float, y: float, z: float) -> Any:
    """Distance (m) of a point from the surface of a shape; of a mesh, from the box around it.

    Of an ellipsoid an estimate, right to a few percent near it.
    """
    if kind == SPHERE:
        return abs(np.sqrt(x * x + y * y + z * z) - a)
    if kind == PLANE:
        return abs(z)
    if kind in (BOX, MESH):
        qx, qy, qz = abs(x) - a, abs(y) - b, abs(z) - c
    elif kind == CYLINDER:
        qx, qy, qz = np.sqrt(x * x + y * y) - a, abs(z) - b, -np.inf
    elif kind == CAPSULE:
        up = max(abs(z) - b, 0.0)
        return abs(np.sqrt(x * x + y * y + up * up) - a)
    else:
        k0 = np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2)
        k1 = np.sqrt((x / a / a) ** 2 + (y / b / b) ** 2 + (z / c / c) ** 2)
        return abs(k0 * (k0 - 1) / k1) if k1 > 0 else min(a, b, c)
    ox, oy, oz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    outside = np.sqrt(ox * ox + oy * oy + oz * oz)
    if outside > 0 or kind == MESH:
        return outside
    return -max(qx, qy, qz)


@kernel
def farthest_pair(frame: I32, first: F32, second: F32, every: int, out: F64) -> None:
    """``out`` (2,): the greatest distance (m) of two bodies' origins (T, 3) at contacts (N,); its row."""
    out[0], out[1] = 0.0, -1.0
    for n in range(0, len(frame), every):
        i = frame[n] if len(first) > 1 else 0
        j = frame[n] if len(second) > 1 else 0
        x = np.float64(first[i, 0]) - second[j, 0]
        y = np.float64(first[i, 1]) - second[j, 1]
        z = np.float64(first[i, 2]) - second[j, 2]
        far = np.sqrt(x * x + y * y + z * z)
        if far > out[0] or (out[1] < 0 and far < np.inf):
            out[0], out[1] = far, n


@kernel
def nearest_pair(first: F32, second: F32, out: F64) -> None:
    """``out`` (2,): the least distance (m) of two bodies' origins (T, 3); the frame, -1 if unknown."""
    out[0], out[1] = np.inf, -1.0
    for k in range(max(len(first), len(second))):
        i, j = min(k, len(first) - 1), min(k, len(second) - 1)
        x = np.float64(first[i, 0]) - second[j, 0]
        y = np.float64(first[i, 1]) - second[j, 1]
        z = np.float64(first[i, 2]) - second[j, 2]
        far = np.sqrt(x * x + y * y + z * z)
        if far < out[0]:
            out[0], out[1] = far, k


@kernel
def add_forces(
    frame: I32, force: F32, sign: float, every: int, sums: F64, touched: NDArray[np.bool_]
) -> None:
    """Add the forces (N, 3) of contacts to the ``sums`` (T, 4): x, y, z, and how strong they are.

    Only at each so many frames (``every``); ``touched`` (T,) becomes true at all of theirs.
    """
    for n in range(len(frame)):
        touched[frame[n]] = True
        if frame[n] % every:
            continue
        x, y, z = np.float64(force[n, 0]), np.float64(force[n, 1]), np.float64(force[n, 2])
        sums[frame[n], 0] += sign * x
        sums[frame[n], 1] += sign * y
        sums[frame[n], 2] += sign * z
        sums[frame[n], 3] += np.sqrt(x * x + y * y + z * z)


@kernel
def peak_below(frame: I32, force: F32, normal: F32, peak: F32, every: int, sums: F64) -> int:
    """The first contact of a pair whose peak (N,) is below the pair's normal force; -1 if none is.

    Only at each so many frames (``every``), and where the normal (N, 3) is of unit length; peaks
    may be 1 % and 0.01 N less. ``sums`` ((T - 1) // every + 1,) N, zero at first: of each frame.
    """
    for n in range(len(frame)):
        if frame[n] % every:
            continue
        square = along = 0.0
        for i in range(3):
            way = np.float64(normal[n, i])
            square += way * way
            along += np.float64(force[n, i]) * way
        if abs(square - 1.0) < 0.01:  # any other is unknown anyway
            sums[frame[n] // every] += abs(along)
    for n in range(len(frame)):
        if frame[n] % every == 0 and peak[n] < 0.99 * sums[frame[n] // every] - 1e-2:
            return n
    return -1


@kernel
def while_at_rest(
    position: F32,
    sums: F64,
    around: F64,
    reach: int,
    still: float,
    every: int,
    least: float,
    most: float,
    aside: float,
    out: F64,
) -> None:
    """How often forces cannot be those on a body that does not move for a while.

    Args:
        position: (T, 3) m.
        sums: (T, 4) N, as ``add_forces``; NaN where they are not known.
        around: (T, 4) N, means over a while, which must be wrong as well; or ``sums``.
        reach: frames before and after a moment of rest.
        still: m; further apart is no rest.
        every: as in ``add_forces``.
        least: N; weaker forces, added up, do not bear it; nor do such that pull it down.
        most: N; it would rise under a greater one.
        aside: N; it would slide under a greater one, unless half as much presses it up.
        out: (6,) in how many of the frames looked at each of these is so, and the first of each.
    """
    out[:3], out[3:] = 0.0, -1.0
    for i in range(-(-reach // every) * every, len(position) - reach, every):
        there = True
        for k in range(3):
            here = position[i, k]
            there &= abs(position[i - reach, k] - here) < still
            there &= abs(position[i + reach, k] - here) < still
        if not there:
            continue
        weak, strong, askew = _unborne(sums, i, least, most, aside)
        on_mean = _unborne(around, i, least, most, aside)
        if weak and on_mean[0]:
            _count(0, i, out)
        if strong and on_mean[1]:
            _count(1, i, out)
        if askew and on_mean[2]:
            _count(2, i, out)


@helper
def _unborne(sums: F64, i: int, least: float, most: float, aside: float) -> tuple[bool, bool, bool]:
    """Forces that are too weak or pull down, press up too much, press aside."""
    up, side = sums[i, 2], np.sqrt(sums[i, 0] ** 2 + sums[i, 1] ** 2)
    return sums[i, 3] < least or up < -least, up > most, side > aside and up < 0.5 * aside


@helper
def _count(k: int, i: int, out: F64) -> None:
    out[k] += 1
    if out[3 + k] < 0:
        out[3 + k] = i


@kernel
def while_untouched(
    position: F32, touched: NDArray[np.bool_], reach: int, least: float, out: F64
) -> None:
    """How often a body does not fall though nothing touches it.

    Args:
        position: (T, 3) m.
        touched: (T,) something may touch it.
        reach: frames before and after a moment.
        least: m that it falls at the least, from the line between its places then, in free fall.
        out: (2,) in how many frames that is so, and the first.
    """
    out[0], out[1], last = 0.0, -1.0, -1
    for i in range(len(position)):
        if touched[i]:
            last = i
        c = i - reach
        if last >= c - reach or c < reach:
            continue
        z = np.float64(position[c, 2])
        sag = z - 0.5 * (np.float64(position[i, 2]) + position[c - reach, 2])
        if sag < least:
            out[0] += 1
            if out[1] < 0:
                out[1] = c
