"""Who stands on whom at one frame, and with what forces: flat faces that meet, and their statics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.polygon import convex_hull, outward

from .paths import GRAVITY
from .solids import Pose, Solid, level_at

F64 = NDArray[np.float64]

GAP = 1e-3
"""m. A face this close to a body's bottom carries it."""
LEVER = 0.05
"""m by which torques are compared with forces."""
EVEN = 1e-3
"""Weight of spreading a load evenly against balancing it."""


class Row(NamedTuple):
    """One contact point: ``by`` pushes ``on`` at a point (3,) m with a force (3,) N, world."""

    by: str
    on: str
    point: F64
    normal: F64
    force: F64
    part_by: int = 0
    part_on: int = 0
    peak: float | None = None


def resting(
    solids: Mapping[str, Solid], poses: Mapping[str, Pose], pushes: Sequence[Row]
) -> tuple[list[Row], dict[str, float]]:
    """The contacts of everything that stands on something, from the top down.

    A body's weight, what stands on it and the vertical parts of ``pushes`` on it are shared by
    its contact points so that forces and torques balance as well as they can.

    Returns:
        the contacts, and the load (N) of each body that nothing stands under.
    """
    loads: dict[str, list[tuple[float, float, float]]] = {name: [] for name in solids}
    for push in pushes:
        for name, sign in ((push.on, 1.0), (push.by, -1.0)):
            if name in loads:
                loads[name].append((push.point[0], push.point[1], -sign * push.force[2]))
    bottoms = {
        name: solid.bottom(poses[name])
        for name, solid in solids.items()
        if solid.body.movable and solid.body.kind == "object"
    }
    faces = {
        name: solid.faces(poses[name])
        for name, solid in solids.items()
        if solid.body.kind not in ("gripper", "region")
    }
    rows: list[Row] = []
    hanging = {}
    for name in sorted(bottoms, key=lambda n: -bottoms[n][:, 2].min()):
        weight = (solids[name].body.mass or 0.0) * GRAVITY
        com = poses[name][0] + _turned(poses[name], solids[name].body.com)
        load = np.array([(com[0], com[1], weight), *loads[name]])
        points = _meeting(name, solids, poses, bottoms[name], faces)
        total = float(load[:, 2].sum())
        if not points:
            hanging[name] = total
            continue
        if total <= 0:
            continue
        for (by, part, point, normal), force in zip(points, _shared(points, load), strict=True):
            lowest = _part_at(solids[name], poses[name], point)
            rows.append(Row(by, name, point, normal, np.array([0, 0, force]), part, lowest))
            loads[by].append((point[0], point[1], force))
    return rows, hanging


_Point = tuple[str, int, F64, F64]


def _meeting(
    name: str,
    solids: Mapping[str, Solid],
    poses: Mapping[str, Pose],
    bottom: F64,
    faces: Mapping[str, list[tuple[F64, F64]]],
) -> list[_Point]:
    """Where a body's bottom lies on faces of others: by whom, which part, where, which normal."""
    base = convex_hull(bottom[:, :2])
    middle, level = bottom[:, :2].mean(0), float(bottom[:, 2].min())
    found: list[_Point] = []
    for other, upward in faces.items():
        if other == name:
            continue
        for face in upward:
            if abs(level_at(face, middle) - level) > GAP:
                continue
            meeting = _clipped(base, convex_hull(face[1][:, :2]))
            for point in _corners(meeting):
                place = np.array([*point, level_at(face, point)])
                part = _part_at(solids[other], poses[other], place)
                found.append((other, part, place, face[0]))
    return found


def _clipped(subject: F64, window: F64) -> F64:
    """(N, 2) what of a convex polygon, segment or point lies in a convex window."""
    out, normals = subject, outward(window)
    if (subject @ normals.T <= (normals * window).sum(1) + 1e-9).all():
        return subject
    for normal, corner in zip(normals, window, strict=True):
        if not len(out):
            break
        beyond = (out - corner) @ normal
        kept = []
        for i, point in enumerate(out):
            before = i - 1
            if (beyond[i] > 1e-9) != (beyond[before] > 1e-9):
                share = beyond[before] / (beyond[before] - beyond[i])
                kept.append(out[before] + share * (point - out[before]))
            if beyond[i] <= 1e-9:
                kept.append(point)
        out = np.array(kept).reshape(-1, 2)
    return convex_hull(np.unique(out.round(9), axis=0)) if len(out) else out


def _corners(polygon: F64) -> F64:
    """At most eight corners that stand for a polygon: all of them, or the farthest eight ways."""
    if len(polygon) <= 8:
        return polygon
    angles = np.pi / 4 * np.arange(8)
    ways = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray(polygon[np.unique((polygon @ ways).argmax(0))])


def _shared(points: Sequence[_Point], load: F64) -> F64:
    """(P,) N, upward: least squares over force and torque, none pulling, as even as can be."""
    from scipy.optimize import nnls

    place = np.array([point[2][:2] for point in points])
    total = load[:, 2].sum()
    centre = (load[:, :2] * load[:, 2:]).sum(0) / total
    arm = (place - centre) / LEVER
    matrix = np.concatenate([np.ones((1, len(points))), arm.T, EVEN * np.eye(len(points))])
    forces = nnls(matrix, np.array([total, 0, 0] + [0.0] * len(points)))[0]
    return np.asarray(forces * (total / forces.sum()))


def _part_at(solid: Solid, pose: Pose, point: F64) -> int:
    """Index of the body's geom whose box reaches closest to a world point."""
    if len(solid.body.geoms) == 1:
        return 0
    from safestage_eval.geometry.pose import inverse_transform, matrix

    local = inverse_transform(pose[0], pose[1], point)
    solids = solid.shape.solids
    at = np.array([g.position for g in solid.body.geoms])
    away = np.einsum("gji,gj->gi", matrix([g.orientation for g in solid.body.geoms]), local - at)
    return int((np.maximum(np.abs(away) - solids.half, 0) ** 2).sum(1).argmin())


def _turned(pose: Pose, vector: Sequence[float]) -> F64:
    from safestage_eval.geometry.pose import rotate

    return rotate(pose[1], np.array(vector))
