"""Where bodies touch or nearly do, from their shapes: contact patches without recorded contacts."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.episode.body import IDENTITY
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.pose import matrix
from safestage_eval.geometry.shape import BodyShape

from .facing import overlap

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

NEAR = 1e-3
"""m. What is no further apart than this may take a load as soon as something gives way."""
PROBE = 1e-4
"""m. By so much a shape is moved to see in which direction its distance grows."""
WITHIN = NEAR + 2 * PROBE
"""m. Larger distances are not measured."""
ROLLS = 2e-5
"""m, likewise of a round side."""
DEEP = 5e-3
"""m. A patch reaches no deeper into the other body than this."""


FAR = 1e3
"""m, half of what has no end (a plane)."""


class Patch(NamedTuple):
    """Contact points of two bodies.

    Attributes:
        position: (P, 3) m, world.
        normal: (P, 3) unit, from the first body to the second.
        friction: (P,) the greater of the two geoms'.
        force: (P, 3) N, of the first body on the second, world; 0 where they are only near.
    """

    position: F64
    normal: F64
    friction: F64
    force: F64


NOTHING = Patch(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))


class Part(NamedTuple):
    """One geom of a body at F frames, or 1 if it never moves.

    Attributes:
        shape: it alone.
        corners: (F, V, 3) m, world; none of a plane.
        low, high: (F, 3) m, corners of a box around it.
        friction: its own.
        axis: (F, 3) its own z in the world.
    """

    shape: BodyShape
    corners: F64
    low: F64
    high: F64
    friction: float
    axis: F64


class Neighbours:
    """Contact patches at chosen frames; bodies are indices into ``header.bodies``."""

    def __init__(self, episode: Episode, robot: Collection[int]) -> None:
        """Nothing is measured before it is asked for; the ``robot`` is left out."""
        self._robot = robot
        self._episode = episode
        self._shapes: dict[int, list[BodyShape]] = {}
        self._unmoved: dict[int, list[Part]] = {}

    def patches(
        self, first: int, second: int, frames: NDArray[np.intp]
    ) -> tuple[Patch, NDArray[np.int64]]:
        """The points in which the two touch or are within ``NEAR``, by frame, and how many (F,)."""
        patches = [NOTHING]
        at = [np.zeros(0, np.intp)]
        for x, y in product(self._placed(first, frames), self._placed(second, frames)):
            meets = np.logical_and(x.low <= y.high + NEAR, y.low <= x.high + NEAR).all(axis=1)
            close = np.flatnonzero(np.broadcast_to(meets, len(frames)))
            if not len(close):
                continue
            normal, near = self._normals(first, second, x, y, frames[close])
            if not near.any():
                continue
            close, normal = close[near], normal[near]
            one, other = (p.corners[close if len(p.corners) > 1 else slice(1)] for p in (x, y))
            play = np.stack([_play(p, normal, close) for p in (x, y)], 1)
            points, many = overlap(one, other, normal, play, NEAR / 5)
            rough = np.full(len(points), max(x.friction, y.friction))
            normals = np.repeat(normal, many, axis=0)
            patches.append(Patch(points, normals, rough, np.zeros_like(normals)))
            at.append(np.repeat(close, many))
        return by_frame(patches, np.concatenate(at), len(frames))

    def about(self, bodies: NDArray[np.intp], frames: NDArray[np.intp]) -> Bool:
        """(F, B, N) bodies whose shapes' boxes come within ``NEAR`` of those of some (B,)."""
        low, high = self._boxes(frames, bodies.tolist())
        near = np.ones((len(frames), len(bodies), low.shape[1]), np.bool_)
        for axis in range(3):
            under, over = low[..., axis], high[..., axis]
            near &= under[:, bodies, None] <= over[:, None] + NEAR
            near &= under[:, None] <= over[:, bodies, None] + NEAR
        near[:, np.arange(len(bodies)), bodies] = False
        return near

    def _boxes(self, frames: NDArray[np.intp], wanted: list[int]) -> tuple[F64, F64]:
        """(F, N, 3) lowest and highest corner (m, world) of a box around each body.

        Inverted of what has no shape, of the robot, and of what is too far from the wanted bodies,
        however it is turned.
        """
        low = np.full((len(frames), len(self._episode.header.bodies), 3), np.inf)
        high = -low
        known = self._boxes_of
        first = [body for body in wanted if body in known]
        for body in first:
            low[:, body], high[:, body] = self._box(body, frames)
        under, over = low[:, first] - NEAR, high[:, first] + NEAR
        for body in known.keys() - first:
            centre, radius = self._position(body, frames)[:, None], self._radius(body)
            if ((centre - radius <= over) & (centre + radius >= under)).all(axis=2).any():
                low[:, body], high[:, body] = self._box(body, frames)
        return low, high

    def _box(self, body: int, frames: NDArray[np.intp]) -> tuple[F64, F64]:
        """(F, 3) lowest and highest corner (m, world) of a box around a body, or (1, 3)."""
        middle, half = self._boxes_of[body]
        track = self._episode.tracks[self._episode.header.bodies[body].name]
        turn = matrix(track.orientation[frames if len(track) > 1 else slice(0, 1)])
        reach = np.abs(turn) @ half
        centre = self._position(body, frames) + turn @ middle
        return centre - reach, centre + reach

    def _position(self, body: int, frames: NDArray[np.intp]) -> NDArray[np.float32]:
        """(F, 3) m, or (1, 3) of a body that never moves."""
        position = self._episode.tracks[self._episode.header.bodies[body].name].position
        return position[frames] if len(position) > 1 else position

    def _radius(self, body: int) -> float:
        """m, of a ball around its origin that holds its box, rounding included."""
        middle, half = self._boxes_of[body]
        return 1.01 * float(np.linalg.norm(middle) + np.linalg.norm(half)) + 1e-6

    @cached_property
    def _boxes_of(self) -> dict[int, tuple[F64, F64]]:
        """Body with a shape → middle and half lengths (3,) m of a box around it, body axes."""
        return {
            i: (self._middle(body), np.minimum(self._shape(body).half, FAR))
            for i, body in enumerate(self._episode.header.bodies)
            if i not in self._robot and body.geoms and body.kind != "region"
        }

    def _middle(self, body: Body) -> F64:
        """(3,) m, of its box, body frame: of a level plane far below it."""
        level = [g.kind == "plane" and g.orientation == IDENTITY for g in body.geoms]
        if level and all(level):
            return np.array([0.0, 0.0, max(g.position[2] for g in body.geoms) - FAR])
        return self._shape(body).centre

    def _shape(self, body: Body) -> BodyShape:
        return BodyShape.build(body, self._episode.meshes)

    def _placed(self, body: int, frames: NDArray[np.intp]) -> list[Part]:
        if body in self._unmoved:
            return self._unmoved[body]
        about = self._episode.header.bodies[body]
        if body not in self._shapes:
            self._shapes[body] = [
                BodyShape.build(
                    about.model_copy(update={"name": f"{about.name}/{k}", "geoms": (geom,)}),
                    self._episode.meshes,
                )
                for k, geom in enumerate(about.geoms)
            ]
        position, orientation = self._poses(body, frames)
        turn = matrix(orientation)
        parts = []
        for shape in self._shapes[body]:
            solid, friction = shape.polytopes[0], shape.geoms[0].friction[0]
            up = turn @ matrix(np.asarray(shape.geoms[0].orientation))[:, 2]
            if solid is None:
                side = np.full((len(turn), 3), np.inf)
                parts.append(Part(shape, np.zeros((1, 0, 3)), -side, side, friction, up))
            else:
                corners = solid.vertices @ turn.swapaxes(1, 2) + position[:, None]
                low, high = corners.min(1), corners.max(1)
                parts.append(Part(shape, corners, low, high, friction, up))
        if len(self._episode.tracks[about.name]) == 1:
            self._unmoved[body] = parts
        return parts

    def _poses(self, body: int, frames: NDArray[np.intp]) -> tuple[F64, F64]:
        """(F, 3) m and (F, 4), or one of each of a body that never moves."""
        track = self._episode.tracks[self._episode.header.bodies[body].name]
        at = frames if len(track) > 1 else slice(1)
        return track.position[at].astype(np.float64), track.orientation[at].astype(np.float64)

    def _normals(
        self, first: int, second: int, x: Part, y: Part, frames: NDArray[np.intp]
    ) -> tuple[F64, Bool]:
        """(F, 3) unit, from the first geom to the second, where their distance grows.

        And (F,) where they are within ``NEAR`` and it does.
        """
        (p, q), (r, s) = self._poses(first, frames), self._poses(second, frames)
        steps = np.concatenate([np.zeros((1, 3)), PROBE * np.eye(3), -PROBE * np.eye(3)])
        r, s = (np.broadcast_to(v, (len(frames), v.shape[1])) for v in (r, s))
        if len(p) > 1:
            p, q = np.repeat(p, 7, axis=0), np.repeat(q, 7, axis=0)
        moving = Mover.build(y.shape, (r[:, None] + steps).reshape(-1, 3), np.repeat(s, 7, axis=0))
        apart = clearance_series([Mover.build(x.shape, p, q)], [moving], WITHIN, deep=True)
        gap = ((apart.lower + apart.upper) / 2).reshape(-1, 7)
        near = np.isfinite(gap).all(axis=1) & (gap[:, 0] <= NEAR) & (gap[:, 0] >= -DEEP)
        gap[~near] = 0.0
        slope = gap[:, 1:4] - gap[:, 4:]
        size = np.sqrt((slope**2).sum(axis=1))
        near &= size >= PROBE / 2
        return slope / np.where(near, size, 1.0)[:, None], near


def by_frame(
    patches: list[Patch], at: NDArray[np.intp], frames: int
) -> tuple[Patch, NDArray[np.int64]]:
    """Points (P,) of several patches, at frames (P,) of F, by frame; and how many (F,) there are."""
    order = np.argsort(at, kind="stable")
    whole = (np.concatenate(values)[order] for values in zip(*patches, strict=True))
    return Patch(*whole), np.bincount(at, minlength=frames)


def _play(part: Part, normal: F64, frames: NDArray[np.intp]) -> F64:
    """(F,) how far (m) behind the foremost a corner still touches: a round side rolls on one line."""
    kind = part.shape.geoms[0].kind
    round_ = np.full(len(normal), kind in ("sphere", "ellipsoid", "capsule"))
    if kind == "cylinder":
        axis = part.axis[frames if len(part.axis) > 1 else slice(1)]
        round_ = np.abs((axis * normal).sum(axis=1)) < 0.7
    return np.where(round_, ROLLS, NEAR)
