"""Support between bodies at one frame, and its forces: flat faces that meet, and their statics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.polygon import clip, convex_hull, outward
from safestage_eval.geometry.pose import inverse_transform, matrix, rotate

from .paths import GRAVITY
from .solids import Pose, Solid, level_at

F64 = NDArray[np.float64]
T = TypeVar("T")

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
class Placed:
    """A body at the present frame: ``pose`` is body frame to world, ``key`` tells whether it has moved."""

    solid: Solid
    pose: Pose
    key: bytes

    @cached_property
    def stands(self) -> bool:
        """Whether it is one that stands on others."""
        return self.solid.body.movable and self.solid.body.kind == "object"

    @cached_property
    def bottom(self) -> F64:
        """(N, 3) m, world, its lowest points; none of what stands on nothing."""
        return self.solid.bottom(self.pose) if self.stands else np.empty((0, 3))

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

    @cached_property
    def around(self) -> F64:
        """(3,) m, world, the middle of a ball around it."""
        return self.of(self.solid.shape.centre)

    def of(self, point: Sequence[float] | F64) -> F64:
        """(3,) m, world: a point of the body."""
        return np.asarray(self.pose[0] + rotate(self.pose[1], np.array(point)))

    def far_from(self, other: Placed) -> bool:
        """Whether no point of the two can be closer than ``GAP``."""
        reach = self.solid.shape.radius + other.solid.shape.radius + GAP
        return bool(((self.around - other.around) ** 2).sum() > reach**2)

    def part_at(self, point: F64) -> int:
        """Index of the geom whose box reaches closest to a world point."""
        geoms = self.solid.body.geoms
        if len(geoms) == 1:
            return 0
        local = inverse_transform(*self.pose, point)
        away = local - np.array([geom.position for geom in geoms])
        away = np.einsum("gji,gj->gi", matrix([geom.orientation for geom in geoms]), away)
        outside = np.maximum(np.abs(away) - self.solid.shape.solids.half, 0)
        return int((outside**2).sum(1).argmin())


_Point = tuple[str, int, F64, F64]
"""By whom, by which part of it, where (3,) m, and the normal (3,) of its face."""

_Answer = tuple[list[Row], dict[str, float]]


class Resting:
    """The contacts of everything that stands on something, frame by frame.

    What has not moved since the last frame is not looked at again.
    """

    def __init__(self, solids: Mapping[str, Solid]) -> None:
        """``solids``: all bodies."""
        self._solids = solids
        self._found: dict[tuple[str, ...], tuple[bytes, Any]] = {}

    def _as_before(self, what: tuple[str, ...], key: bytes, find: Callable[[], T]) -> T:
        """What was found the last time, if the key is the same."""
        if what not in self._found or self._found[what][0] != key:
            self._found[what] = key, find()
        found: T = self._found[what][1]
        return found

    def at(self, poses: Mapping[str, Pose], pushes: Sequence[Row]) -> _Answer:
        """The contacts at one frame, from the top down.

        A body's weight, what stands on it and the vertical parts of ``pushes`` on it are shared by
        its contact points so that forces and torques balance as well as they can.

        Returns:
            the contacts, and the load (N) of each body that nothing stands under.
        """
        vectors = [part for pose in poses.values() for part in pose]
        vectors += [part for push in pushes for part in (push.point, push.force)]
        key = (np.concatenate(vectors).round(7) + 0.0).tobytes()
        return self._as_before((), key, lambda: self._at(poses, pushes))

    def _at(self, poses: Mapping[str, Pose], pushes: Sequence[Row]) -> _Answer:
        loads: dict[str, list[tuple[float, float, float]]] = {name: [] for name in self._solids}
        for push in pushes:
            for name, sign in ((push.on, 1.0), (push.by, -1.0)):
                if name in loads:
                    loads[name].append((push.point[0], push.point[1], -sign * push.force[2]))
        placed = {name: self._placed(name, pose) for name, pose in poses.items()}
        standing = [name for name, body in placed.items() if body.stands]
        rows: list[Row] = []
        hanging = {}
        for name in sorted(standing, key=lambda n: -placed[n].bottom[:, 2].min()):
            body = placed[name]
            com, weight = body.of(body.solid.body.com), (body.solid.body.mass or 0.0) * GRAVITY
            load = np.array([(com[0], com[1], weight), *loads[name]])
            points = [
                point
                for other in placed
                if other != name
                for point in self._as_before(
                    (name, other),
                    body.key + placed[other].key,
                    partial(_meeting, body, other, placed[other]),
                )
            ]
            if not points:
                hanging[name] = float(load[:, 2].sum())
            elif load[:, 2].sum() > 0:
                place = np.array([point[2][:2] for point in points])
                key = place.tobytes() + load.tobytes()
                forces = self._as_before((name,), key, partial(_shared, place, load))
                for (by, part, point, normal), force in zip(points, forces, strict=True):
                    up = np.array([0, 0, force])
                    rows.append(Row(by, name, point, normal, up, part, body.part_at(point)))
                    loads[by].append((point[0], point[1], force))
        return rows, hanging

    def _placed(self, name: str, pose: Pose) -> Placed:
        key = pose[0].tobytes() + pose[1].tobytes()
        return self._as_before(("", name), key, lambda: Placed(self._solids[name], pose, key))


def _meeting(body: Placed, name: str, other: Placed) -> list[_Point]:
    """Places where a body's bottom lies on faces of another, which has this name."""
    result: list[_Point] = []
    if body.far_from(other):
        return result
    middle, level = body.bottom[:, :2].mean(0), float(body.bottom[:, 2].min())
    for face in other.faces:
        normal, corners = face
        if abs(level_at(face, middle) - level) <= GAP:
            for point in _corners(_clipped(body.base, convex_hull(corners[:, :2]))):
                place = np.array([*point, level_at(face, point)])
                result.append((name, other.part_at(place), place, normal))
    return result


def _shared(place: F64, load: F64) -> F64:
    """(P,) N, upward: least squares over force and torque, none pulling, as even as can be."""
    from scipy.optimize import nnls

    total = load[:, 2].sum()
    arm = (place - (load[:, :2] * load[:, 2:]).sum(0) / total) / LEVER
    balance = np.concatenate([np.ones((1, len(place))), arm.T, EVEN * np.eye(len(place))])
    forces = nnls(balance, np.array([total, 0, 0] + [0.0] * len(place)))[0]
    return np.asarray(forces * (total / forces.sum()))


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
