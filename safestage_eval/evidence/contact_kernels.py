"""Sums over rows of contacts, frame by frame, in the order of the rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
F32 = NDArray[np.float32]

UNIT = 1e-3
"""Allowed deviation of a normal's length from 1."""
PULL = 1e-3
"""N, and share of the force, by which a contact may pull for rounding."""


def add_up(frame: NDArray[Any], values: NDArray[Any], frames: int) -> F64:
    """(T,) sum of the values (N,) at each frame; ``frame`` (N,) may hold none beyond T."""
    sums = np.zeros(frames)
    if _usual(frame, np.int32) and _usual(values, np.float32) and _add_up(frame, values, sums):
        return sums
    return np.asarray(np.bincount(frame, values, minlength=frames), np.float64)


def add_up_normal(
    frame: NDArray[Any], force: NDArray[Any], normal: NDArray[Any], frames: int
) -> tuple[F64, bool]:
    """(T,) N, sum at each frame of how strong forces (N, 3) are along normals (N, 3).

    And whether no row is ``strange``, for sure.
    """
    sums, usual = np.zeros(frames), _usual(force, np.float32) and _usual(normal, np.float32)
    if usual and _usual(frame, np.int32):
        found = _add_up_normal(frame, force, normal, sums)
        if found >= 0:
            return sums, found == 0
    long, pulls = strange(force, normal)
    fx, fy, fz = force.astype(np.float64).T
    along = np.abs(fx * normal[:, 0] + fy * normal[:, 1] + fz * normal[:, 2])
    total = np.asarray(np.bincount(frame, along, minlength=frames), np.float64)
    return total, not (long | pulls).any()


def strange(
    force: NDArray[Any], normal: NDArray[Any]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N,) forces along a normal that is not of unit length; (N,) forces that pull.

    Of a contact without force no normal is needed.
    """
    f, n = force.astype(np.float64), normal.astype(np.float64)
    some = (f != 0).any(axis=1)
    long = some & ~(np.abs(np.einsum("ij,ij->i", n, n) - 1) <= 2 * UNIT)
    along = np.einsum("ij,ij->i", f, n)
    size = np.sqrt(np.einsum("ij,ij->i", f, f))
    return long, some & ~long & ~(along >= -PULL * (1 + size))


def rows_by_frame(
    frame: NDArray[Any], force: NDArray[Any], normal: NDArray[Any], frames: int
) -> NDArray[np.intp]:
    """(K,) those of N rows that have a force along the normal, by frame, else in their order."""
    usual = _usual(force, np.float32) and _usual(normal, np.float32) and _usual(frame, np.int32)
    if usual:
        starts, rows = np.zeros(frames + 1, np.intp), np.empty(len(frame), np.intp)
        count = _rows_by_frame(frame, force, normal, starts, rows)
        if count >= 0:
            return rows[:count].copy()
    (nx, ny, nz), (fx, fy, fz) = normal.T, force.T
    found = np.flatnonzero(nx * fx + ny * fy + nz * fz)
    return found.take(np.argsort(frame.take(found), kind="stable"))


def _usual(array: NDArray[Any], dtype: type[np.generic]) -> bool:
    """It is as the kernels take it."""
    return array.dtype == dtype and array.flags.carray


@kernel
def _add_up(frame: I32, values: F32, sums: F64) -> bool:
    """False for a frame that is not among those of the sums, which mean nothing then."""
    for n in range(len(frame)):
        t = frame[n]
        if not 0 <= t < len(sums):
            return False
        sums[t] += np.float64(values[n])
    return True


@kernel
def _add_up_normal(frame: I32, force: F32, normal: F32, sums: F64) -> int:
    """How many rows may be ``strange``; -1 as ``_add_up``."""
    found = 0
    for n in range(len(frame)):
        t = frame[n]
        if not 0 <= t < len(sums):
            return -1
        fx, fy, fz = np.float64(force[n, 0]), np.float64(force[n, 1]), np.float64(force[n, 2])
        nx, ny, nz = np.float64(normal[n, 0]), np.float64(normal[n, 1]), np.float64(normal[n, 2])
        along = fx * nx + fy * ny + fz * nz
        sums[t] += abs(along)
        if not (along >= 0 and abs(nx * nx + ny * ny + nz * nz - 1) <= 2 * UNIT):
            size = np.sqrt(fx * fx + fy * fy + fz * fz)
            unit = abs(nx * nx + ny * ny + nz * nz - 1) <= 2 * UNIT
            if size != 0 and not (unit and along >= -PULL * (1 + size)):
                found += 1
    return found


@kernel
def _rows_by_frame(
    frame: I32, force: F32, normal: F32, starts: NDArray[np.intp], rows: NDArray[np.intp]
) -> int:
    """How many there are; -1 for a frame beyond. ``starts`` (T + 1,) is 0 and room to work in."""
    count = 0
    for n in range(len(frame)):
        if not 0 <= frame[n] < len(starts) - 1:
            return -1
        if _along(force, normal, n) != 0:
            starts[frame[n] + 1] += 1
            count += 1
    for t in range(1, len(starts)):
        starts[t] += starts[t - 1]
    for n in range(len(frame)):
        if _along(force, normal, n) != 0:
            rows[starts[frame[n]]] = n
            starts[frame[n]] += 1
    return count


@helper
def _along(force: F32, normal: F32, n: int) -> Any:
    """In single precision, as it is recorded."""
    return normal[n, 0] * force[n, 0] + normal[n, 1] * force[n, 1] + normal[n, 2] * force[n, 2]
