"""Support between bodies at one frame, and its forces: flat faces that meet, and their statics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.polygon import clip, convex_hull, outward

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


@dataclass(frozen=True, eq=False)
class View:
    """A body at the present frame.

    Attributes:
        solid: the body.
        key: its pose as bytes, to tell whether it has moved.
        pose: body frame to world.
        centre: (3,) m, world, of mass.
        bottom: (N, 3) m, world, its lowest points; none of what stands on nothing.
        around: (3,) m, world, the middle of a ball around it.
    """

    solid: Solid
    key: bytes
    pose: Pose
    centre: F64
    bottom: F64
    around: F64

    @cached_property
    def base(self) -> F64:
        """(H, 2) m, the convex hull of the bottom seen from above."""
        return convex_hull(self.bottom[:, :2]) if len(self.bottom) else self.bottom[:, :2]

    @cached_property
    def faces(self) -> list[tuple[F64, F64]]:
        """Upward ones: unit normal (3,), corners (N, 3) m. What grips or only marks a place has none."""
        if self.solid.body.kind in ("gripper", "region"):
            return []
        return self.solid.faces(self.pose)

    def far_from(self, other: View) -> bool:
        """Whether no point of the two can be closer than ``GAP``."""
        reach = self.solid.shape.radius + other.solid.shape.radius + GAP
        return bool(((self.around - other.around) ** 2).sum() > reach**2)


_Point = tuple[str, int, F64, F64]
"""By whom, by which part of it, where (3,) m, and the normal (3,) of its face."""


class Resting:
    """The contacts of everything that stands on something, frame by frame.

    What has not moved since the last frame is not looked at again.
    """

    def __init__(self, solids: Mapping[str, Solid]) -> None:
        """``solids``: all bodies."""
        self._solids = solids
        self._stands = {n for n, s in solids.items() if s.body.movable and s.body.kind == "object"}
        self._views: dict[str, View] = {}
        self._met: dict[tuple[str, str], tuple[bytes, bytes, list[_Point]]] = {}
        self._forces: dict[str, tuple[bytes, F64]] = {}

    def at(
        self, poses: Mapping[str, Pose], pushes: Sequence[Row]
    ) -> tuple[list[Row], dict[str, float]]:
        """The contacts at one frame, from the top down.

        A body's weight, what stands on it and the vertical parts of ``pushes`` on it are shared by
        its contact points so that forces and torques balance as well as they can.

        Returns:
            the contacts, and the load (N) of each body that nothing stands under.
        """
        loads: dict[str, list[tuple[float, float, float]]] = {name: [] for name in self._solids}
        for push in pushes:
            for name, sign in ((push.on, 1.0), (push.by, -1.0)):
                if name in loads:
                    loads[name].append((push.point[0], push.point[1], -sign * push.force[2]))
        views = {name: self._view(name, poses[name]) for name in self._solids}
        standing = [name for name in self._solids if name in self._stands]
        rows: list[Row] = []
        hanging = {}
        for name in sorted(standing, key=lambda n: -views[n].bottom[:, 2].min()):
            weight = (self._solids[name].body.mass or 0.0) * GRAVITY
            com = views[name].centre
            load = np.array([(com[0], com[1], weight), *loads[name]])
            points = [p for other in views if other != name for p in self._meeting(name, other)]
            total = float(load[:, 2].sum())
            if not points:
                hanging[name] = total
                continue
            if total <= 0:
                continue
            for (by, part, point, normal), force in zip(
                points, self._shared(name, points, load), strict=True
            ):
                lowest = _part_at(self._solids[name], poses[name], point)
                rows.append(Row(by, name, point, normal, np.array([0, 0, force]), part, lowest))
                loads[by].append((point[0], point[1], force))
        return rows, hanging

    def _view(self, name: str, pose: Pose) -> View:
        key = pose[0].tobytes() + pose[1].tobytes()
        if name in self._views and self._views[name].key == key:
            return self._views[name]
        solid = self._solids[name]
        bottom = solid.bottom(pose) if name in self._stands else np.empty((0, 3))
        com, middle = (pose[0] + _turned(pose, v) for v in (solid.body.com, solid.shape.centre))
        self._views[name] = View(solid, key, pose, com, bottom, middle)
        return self._views[name]

    def _meeting(self, name: str, other: str) -> list[_Point]:
        """Places where a body's bottom lies on faces of another."""
        a, b = self._views[name], self._views[other]
        met = self._met.get((name, other))
        if met is None or met[:2] != (a.key, b.key):
            met = a.key, b.key, [] if a.far_from(b) else self._found(a, other)
            self._met[name, other] = met
        return met[2]

    def _found(self, a: View, other: str) -> list[_Point]:
        middle, level = a.bottom[:, :2].mean(0), float(a.bottom[:, 2].min())
        pose = self._views[other].pose
        result: list[_Point] = []
        for face in self._views[other].faces:
            normal, corners = face
            if abs(level_at(face, middle) - level) > GAP:
                continue
            for point in _corners(_clipped(a.base, convex_hull(corners[:, :2]))):
                place = np.array([*point, level_at(face, point)])
                result.append((other, _part_at(self._solids[other], pose, place), place, normal))
        return result

    def _shared(self, name: str, points: Sequence[_Point], load: F64) -> F64:
        """(P,) N, upward: least squares over force and torque, none pulling, as even as can be."""
        from scipy.optimize import nnls

        place = np.array([point[2][:2] for point in points])
        key = place.tobytes() + load.tobytes()
        if name in self._forces and self._forces[name][0] == key:
            return self._forces[name][1]
        total = load[:, 2].sum()
        centre = (load[:, :2] * load[:, 2:]).sum(0) / total
        arm = (place - centre) / LEVER
        matrix = np.concatenate([np.ones((1, len(points))), arm.T, EVEN * np.eye(len(points))])
        forces = nnls(matrix, np.array([total, 0, 0] + [0.0] * len(points)))[0]
        self._forces[name] = key, np.asarray(forces * (total / forces.sum()))
        return self._forces[name][1]


def _clipped(subject: F64, window: F64) -> F64:
    """(N, 2) the part of a convex polygon, segment or point in a convex window."""
    if ((subject @ outward(window).T) <= (outward(window) * window).sum(1) + 1e-9).all():
        return subject
    part = clip(subject, window, 1e-9)
    return convex_hull(np.unique(part.round(9), axis=0)) if len(part) else part


def _corners(polygon: F64) -> F64:
    """At most eight corners that stand for a polygon: all of them, or the farthest eight ways."""
    if len(polygon) <= 8:
        return polygon
    angles = np.pi / 4 * np.arange(8)
    ways = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray(polygon[np.unique((polygon @ ways).argmax(0))])


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


def _turned(pose: Pose, vector: Sequence[float] | F64) -> F64:
    from safestage_eval.geometry.pose import rotate

    return rotate(pose[1], np.array(vector))
