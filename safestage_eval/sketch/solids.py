"""The bodies of a sketch as an episode has them, and the faces that others can stand on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Cavity, Geom
from safestage_eval.geometry.polygon import contains, convex_hull
from safestage_eval.geometry.pose import matrix
from safestage_eval.geometry.shape import BodyShape

from .quantities import HOLLOW, Part, Vec3
from .sketch_model import BodySketch

F64 = NDArray[np.float64]
Pose = tuple[F64, F64]
"""Position (3,) m and orientation (4,) wxyz: body frame to world."""

CUP_SIDES = 16
"""Flat walls around a cup."""
AXES = {
    f"{sign}{axis}": (1.0 if sign == "+" else -1.0) * np.eye(3)[i]
    for i, axis in enumerate("xyz")
    for sign in "+-"
}
"""Side → outward normal (3,), world."""
_LYING = {"z": (1.0, 0.0, 0.0, 0.0), "x": (0.5**0.5, 0.0, 0.5**0.5, 0.0)}
_LYING["y"] = (0.5**0.5, -(0.5**0.5), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Solid:
    """A body with its shape prepared."""

    body: Body

    @cached_property
    def shape(self) -> BodyShape:
        """The body's collision geometry, packed."""
        return BodyShape.build(self.body, {})

    def bottom(self, pose: Pose) -> F64:
        """(N, 3) m, world: the lowest points, as corners of what it could stand on."""
        position, rotation = pose[0], matrix(pose[1])
        points = [part.vertices for part in self.shape.polytopes if part is not None]
        lowest = []
        for geom, vertices in zip(self.body.geoms, points, strict=True):
            if geom.kind == "sphere":
                centre = position + rotation @ np.array(geom.position)
                lowest.append((centre - [0, 0, geom.size[0]])[None])
            else:
                lowest.append(vertices @ rotation.T + position)
        corners = np.concatenate(lowest)
        return np.asarray(corners[corners[:, 2] <= corners[:, 2].min() + FLAT])

    def faces(self, pose: Pose) -> list[tuple[F64, F64]]:
        """Upward faces, world: each one's unit normal (3,) and corners (N, 3) m."""
        rotation = matrix(pose[1])
        normals = self.shape.faces.normal @ rotation.T
        return [
            (normals[i], self.shape.faces.corners[i] @ rotation.T + pose[0])
            for i in np.flatnonzero(normals[:, 2] > 0.5)
        ]


FLAT = 5e-4
"""m. What lies within this of the lowest point belongs to the bottom."""


def level_at(face: tuple[F64, F64], point: F64) -> float:
    """Height (m) of a face's plane over a point (2,)."""
    normal, corners = face
    lean = normal[:2] @ (point - corners[0, :2]) / normal[2]
    return float(corners[0, 2] - lean)


def ground(faces: list[tuple[F64, F64]], point: F64, below: float = np.inf) -> float | None:
    """Height of the highest face over a horizontal point (2,) and not above ``below``."""
    levels = [
        level_at(face, point)
        for face in faces
        if contains(convex_hull(face[1][:, :2]), point[None])[0]
    ]
    levels = [level for level in levels if level <= below]
    return max(levels) if levels else None


def solid(name: str, sketch: BodySketch) -> Solid:
    """Make the body that a sketch's table describes."""
    geoms = tuple(geom for part in sketch.shape for geom in _geoms(part, sketch.friction))
    hollow = [part for part in sketch.shape if part.kind in HOLLOW]
    still = sketch.kind in ("fixture", "region")
    up = sketch.up or ("none" if sketch.shape[0].kind in ("sphere", "ellipsoid") else "z")
    return Solid(
        Body(
            name=name,
            kind=sketch.kind,
            movable=not still if sketch.movable is None else sketch.movable,
            mass=sketch.mass,
            com=_com(sketch.shape),
            up_axis=None if up == "none" else _vec(AXES[f"+{up}"]),
            finger=sketch.finger,
            material=sketch.material,
            tags=sketch.tags,
            parent=sketch.parent,
            geoms=geoms,
            cavity=_cavity(hollow[0]) if hollow else None,
        )
    )


def _geoms(part: Part, friction: float) -> list[Geom]:
    rub = (friction, 0.02, 0.001)
    if part.kind in HOLLOW:
        return [box.model_copy(update={"friction": rub}) for box in _walls(part)]
    at = np.array(part.at)
    if part.kind in ("box", "ellipsoid"):
        size, middle = tuple(s / 2 for s in part.size), part.size[2] / 2
    elif part.kind == "sphere":
        size, middle = (part.size[0] / 2,), part.size[0] / 2
    else:
        radius, half = part.size[0] / 2, part.size[1] / 2
        middle = half if part.along == "z" else radius
        size = (radius, half if part.kind == "cylinder" else half - radius)
    return [
        Geom(
            kind=part.kind,  # type: ignore[arg-type]
            size=size,
            position=_vec(at + _up(middle)),
            orientation=_LYING[part.along],
            friction=rub,
        )
    ]


def _walls(part: Part) -> list[Geom]:
    """A floor and walls; a cup's floor is round and its walls stand in a ring."""
    at, wall = np.array(part.at), part.wall
    if part.kind == "bin":
        x, y, z = (s / 2 for s in part.size)
        boxes = [((x, y, wall / 2), (0.0, 0.0, wall / 2))]
        for sign in (-1, 1):
            boxes.append(((wall / 2, y, z), (sign * (x - wall / 2), 0.0, z)))
            boxes.append(((x, wall / 2, z), (0.0, sign * (y - wall / 2), z)))
        return [Geom(kind="box", size=size, position=_vec(at + p)) for size, p in boxes]
    radius, z = part.size[0] / 2, part.size[1] / 2
    out = [Geom(kind="cylinder", size=(radius, wall / 2), position=_vec(at + _up(wall / 2)))]
    half = np.pi / CUP_SIDES
    for angle in 2 * half * np.arange(CUP_SIDES):
        middle = (radius - wall / 2) * np.array([np.cos(angle), np.sin(angle), 0])
        out.append(
            Geom(
                kind="box",
                size=(wall / 2, (radius - wall) * np.tan(half), z),
                position=_vec(at + middle + _up(z)),
                orientation=(float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))),
            )
        )
    return out


def _cavity(part: Part) -> Cavity:
    height = part.size[-1] - part.wall
    middle = _vec(np.array(part.at) + _up(part.wall + height / 2))
    if part.kind == "bin":
        x, y = (s / 2 - part.wall for s in part.size[:2])
        return Cavity(kind="box", size=(x, y, height / 2), position=middle)
    radius = part.size[0] / 2 - part.wall
    return Cavity(kind="cylinder", size=(radius, height / 2), position=middle)


def _com(parts: tuple[Part, ...]) -> Vec3:
    """Centre of the volumes of all parts, a hollow one counted with its walls only."""
    total, moment = 0.0, np.zeros(3)
    for part in parts:
        for geom in _geoms(part, 1.0):
            volume = float(np.prod(geom.size)) if geom.kind != "cylinder" else 0.0
            if geom.kind == "cylinder":
                volume = np.pi / 4 * geom.size[0] ** 2 * geom.size[1]
            total += volume
            moment += volume * np.array(geom.position)
    return _vec(moment / total)


def _up(height: float) -> F64:
    return np.array([0.0, 0.0, height])


def _vec(values: F64) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
