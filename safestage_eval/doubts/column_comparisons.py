"""How poses, velocities, contacts and shapes compare, over all frames at once."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.scene_shapes import (
    BOX,
    CAPSULE,
    CYLINDER,
    MESH,
    PLANE,
    SPHERE,
    BodyShapes,
)

Bool = NDArray[np.bool_]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
Floats = NDArray[np.floating]


class Motions(NamedTuple):
    """The motion of a body by its poses and by its velocities, added up over windows.

    Attributes:
        ends: (S,) the frame behind each step that both tell of.
        seconds: (S,) how long each takes.
        off: (S,) m or rad by which the two differ in it.
        by_pose: (W, 3) m or rad in each window.
        by_velocity: (W, 3) likewise.
        lasted: (W,) s.
    """

    ends: NDArray[np.intp]
    seconds: F64
    off: Floats
    by_pose: F64
    by_velocity: F64
    lasted: F64

    def beyond(self, constant: float, per_second: float) -> tuple[float, int]:
        """By how much (m, rad) the worst step differs by more than it may; its frame, -1: none does."""
        if not len(self.off):
            return 0.0, -1
        over = self.off - constant - per_second * self.seconds
        worst = int(over.argmax())
        return (float(over[worst]), int(self.ends[worst])) if over[worst] > 0 else (0.0, -1)

    def sizes(self, shake: float = 0.0, rounding: float = 0.0) -> tuple[float, float, float]:
        """Roots of the sums of squares of what poses say, of what velocities say, of the difference.

        Args:
            shake: m/s (rad/s) by which velocities may say more than poses in each window.
            rounding: m (rad) by which the two may differ in a window besides.
        """
        pose, speed, apart = map(
            lengths, (self.by_pose, self.by_velocity, self.by_pose - self.by_velocity)
        )
        apart = np.maximum(apart - rounding, 0)
        apart = np.where(speed > pose, np.maximum(apart - shake * self.lasted, 0), apart)
        first, second, third = (float(np.sqrt(x @ x)) for x in (pose, speed, apart))
        return first, second, third


def compare_motion(
    t: F64, pose: F32, rate: F32, unseen: Bool | None, longest: float, window: float
) -> Motions:
    """Compare the way of a body with its velocities.

    Args:
        t: (T,) s.
        pose: (T, 3) m or (T, 4) quaternions wxyz.
        rate: (T, 3) m/s or rad/s.
        unseen: (T,) frames to leave out.
        longest: s; steps that take longer are left out.
        window: s over which motion is added up.
    """
    step = np.diff(t)
    whole = step <= longest
    if unseen is not None:
        whole &= ~(unseen[1:] | unseen[:-1])
    half = (0.5 * step).astype(np.float32)[:, None]
    said = (rate[1:] + rate[:-1]) * half
    went = pose[1:] - pose[:-1] if pose.shape[1] == 3 else turns(pose)
    off = lengths(went - said)
    whole &= np.isfinite(off)
    ends = np.flatnonzero(whole)
    if not len(ends):
        none = np.zeros((0, 3))
        return Motions(ends, step[:0], off[:0], none, none, step[:0])
    if len(ends) < len(step):
        went, said, off, step = went[ends], said[ends], off[ends], step[ends]
    new = np.append(True, np.diff(ends) > 1)
    begun = t[ends]  # since when its stretch without a break lasts
    begun = begun[np.flatnonzero(new)][np.cumsum(new) - 1]
    number = np.floor((t[ends] - begun) / window * (1 + 1e-9))
    starts = np.flatnonzero(new | np.append(True, np.diff(number) != 0))
    by_pose, by_velocity = (
        np.add.reduceat(part, starts, axis=0, dtype=np.float64) for part in (went, said)
    )
    return Motions(ends + 1, step, off, by_pose, by_velocity, np.add.reduceat(step, starts))


def turns(orientation: F32) -> Any:
    """(T - 1, 3) rotation vectors (rad, world) from each quaternion to the next, the shorter way round."""
    q = np.ascontiguousarray(orientation.T, np.float64)
    (a, b, c, d), (e, f, g, h) = q[:, 1:], q[:, :-1]
    w = a * e + b * f + c * g + d * h
    axis = np.stack(
        [
            b * e - a * f + d * g - c * h,
            c * e - a * g + b * h - d * f,
            d * e - a * h + c * f - b * g,
        ],
        1,
    )
    size = lengths(axis)
    angle = 2 * np.arctan2(size, np.abs(w))
    return axis * (np.copysign(angle, w) / np.maximum(size, 1e-300))[:, None]


def surface_distances(
    frame: I32, point: F32, position: F32, orientation: F32, shapes: BodyShapes
) -> F64:
    """How far (m) points lie from the surface of the nearest shape of one body; NaN where unknown.

    Args:
        frame: (N,) of each point.
        point: (N, 3) m, world.
        position: (T, 3) m of the body, or one row of a fixed one.
        orientation: (T, 4) wxyz, likewise.
        shapes: of the body.
    """
    at = frame if len(position) > 1 else frame * 0
    away = point.astype(np.float64) - position[at]
    turn = orientation[at].astype(np.float64)
    w, v = turn[:, :1], turn[:, 1:]
    across = _cross(v, away)
    local = away - 2 * w * across + 2 * _cross(v, across)  # into the body frame
    least = np.full(len(point), np.inf)
    for kind in {*shapes.kind.tolist()}:
        some = shapes.kind == kind
        inside = np.einsum("gni,gij->gnj", local - shapes.place[some, None], shapes.axes[some])
        least = np.minimum(least, _surface(kind, shapes.size[some, None], inside).min(axis=0))
    return np.where(np.isfinite(local).all(axis=1), least, np.nan)


def _surface(kind: int, size: F64, point: F64) -> Any:
    """(G, N) distance (m) of points (G, N, 3) from the surface of shapes; of a mesh, from the box around it.

    Of an ellipsoid an estimate, right to a few percent near it.
    """
    x, y, z = np.moveaxis(point, -1, 0)
    a, b, _ = np.moveaxis(size, -1, 0)
    if kind == SPHERE:
        return np.abs(lengths(point) - a)
    if kind == PLANE:
        return np.abs(z)
    if kind == CAPSULE:
        up = np.maximum(np.abs(z) - b, 0)
        return np.abs(np.sqrt(x * x + y * y + up * up) - a)
    if kind in (BOX, MESH):
        beyond = np.abs(point) - size
    elif kind == CYLINDER:
        beyond = np.stack([np.hypot(x, y) - a, np.abs(z) - b], -1)
    else:
        k0, k1 = lengths(point / size), lengths(point / size**2)
        return np.where(k1 > 0, np.abs(k0 * (k0 - 1) / np.maximum(k1, 1e-300)), size.min(axis=-1))
    outside = lengths(np.maximum(beyond, 0))
    return outside if kind == MESH else np.where(outside > 0, outside, -beyond.max(axis=-1))


def _cross(a: F64, b: F64) -> F64:
    """(N, 3) vector products; of few rows np.cross takes three times as long."""
    after, before = (1, 2, 0), (2, 0, 1)
    product: F64 = a[:, after] * b[:, before] - a[:, before] * b[:, after]
    return product


def lengths(vectors: Floats) -> Any:
    """(…) of vectors (…, 3 or so)."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
