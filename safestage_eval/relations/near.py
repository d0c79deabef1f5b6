"""Where bodies touch or nearly do, from their shapes: contact patches without recorded contacts."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.episode.body import IDENTITY
from safestage_eval.geometry.clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.pose import matrix
from safestage_eval.geometry.shape import BodyShape
from safestage_eval.signals.facts import Movers

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

NEAR = 5e-4
"""m. What is no further apart than this may take a load as soon as something gives way."""
PROBE = 1e-4
"""m. By so much a shape is moved to see in which direction its distance grows."""
ROLLS = 2e-5
"""m, likewise of a round side."""
CORNERS = 12
"""Of a round outline so many are looked at: the patch is 3 % smaller at most."""
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
    """

    position: F64
    normal: F64
    friction: F64


class Part(NamedTuple):
    """One geom of a body at one frame: its shape, corners (V, 3) or None of a plane, and box.

    ``axis`` (3,) is its own z in the world.
    """

    shape: BodyShape
    corners: F64 | None
    low: F64
    high: F64
    friction: float
    axis: F64


class Neighbours:
    """Contact patches at chosen frames; bodies are indices into ``header.bodies``."""

    def __init__(self, episode: Episode, movers: Movers, robot: Collection[int]) -> None:
        """Nothing is measured before it is asked for; the ``robot`` is left out."""
        self._robot = robot
        self._episode = episode
        self._movers = movers
        self._shapes: dict[int, list[BodyShape]] = {}
        self._parts: dict[int, list[Part]] = {}
        self._frame = -1

    def patch(self, first: int, second: int, frame: int) -> Patch | None:
        """The points in which the two touch or are within ``NEAR``; None if there are none."""
        found = []
        a, b = self._at(first, frame), self._at(second, frame)
        for x, y in product(a, b):
            if (x.low > y.high + NEAR).any() or (y.low > x.high + NEAR).any():
                continue
            normal = self._normal(first, second, x, y, frame)
            if normal is None:
                continue
            points = _common(x, y, normal)
            if len(points):
                found.append((points, normal, max(x.friction, y.friction)))
        if not found:
            return None
        return Patch(
            np.concatenate([p for p, _, _ in found]),
            np.concatenate([np.broadcast_to(n, p.shape) for p, n, _ in found]),
            np.concatenate([np.full(len(p), mu) for p, _, mu in found]),
        )

    def about(self, bodies: Sequence[int], frames: NDArray[np.intp]) -> Bool:
        """(F, B, N) bodies whose shapes' boxes come within ``NEAR`` of those of some (B,)."""
        low, high = self._boxes(frames)
        near = np.ones((len(frames), len(bodies), low.shape[1]), np.bool_)
        for axis in range(3):
            under, over = low[..., axis], high[..., axis]
            near &= under[:, bodies, None] <= over[:, None] + NEAR
            near &= under[:, None] <= over[:, bodies, None] + NEAR
        near[:, np.arange(len(bodies)), bodies] = False
        return near

    def _boxes(self, frames: NDArray[np.intp]) -> tuple[F64, F64]:
        """(F, N, 3) lowest and highest corner (m, world) of a box around each body.

        Inverted of what has no shape, and of the robot.
        """
        bodies = self._episode.header.bodies
        low = np.full((len(frames), len(bodies), 3), np.inf)
        high = -low
        for body, (middle, half) in self._boxes_of.items():
            track = self._episode.tracks[bodies[body].name]
            at = frames if len(track) > 1 else slice(0, 1)
            turn = matrix(track.orientation[at])
            reach = np.abs(turn) @ half
            centre = track.position[at] + turn @ middle
            low[:, body], high[:, body] = centre - reach, centre + reach
        return low, high

    @cached_property
    def _boxes_of(self) -> dict[int, tuple[F64, F64]]:
        """Body with a shape → middle and half lengths (3,) m of a box around it, body axes."""
        return {
            i: (self._middle(body), np.minimum(self._movers[body.name].shape.half, FAR))
            for i, body in enumerate(self._episode.header.bodies)
            if i not in self._robot and body.geoms and body.kind != "region"
        }

    def _middle(self, body: Body) -> F64:
        """(3,) m, of its box, body frame: of a level plane far below it."""
        level = [g.kind == "plane" and g.orientation == IDENTITY for g in body.geoms]
        if level and all(level):
            return np.array([0.0, 0.0, max(g.position[2] for g in body.geoms) - FAR])
        return self._movers[body.name].shape.centre

    def _at(self, body: int, frame: int) -> list[Part]:
        if frame != self._frame:
            self._parts.clear()
            self._frame = frame
        if body not in self._parts:
            self._parts[body] = self._placed(body, frame)
        return self._parts[body]

    def _placed(self, body: int, frame: int) -> list[Part]:
        about = self._episode.header.bodies[body]
        if body not in self._shapes:
            self._shapes[body] = [
                BodyShape.build(
                    about.model_copy(update={"name": f"{about.name}/{k}", "geoms": (geom,)}),
                    self._episode.meshes,
                )
                for k, geom in enumerate(about.geoms)
            ]
        position, turn = self._place(body, frame)
        parts = []
        for shape in self._shapes[body]:
            solid = shape.polytopes[0]
            friction = shape.geoms[0].friction[0]
            up = turn @ matrix(np.asarray(shape.geoms[0].orientation)[None])[0][:, 2]
            if solid is None:
                side = np.full(3, np.inf)
                parts.append(Part(shape, None, -side, side, friction, up))
            else:
                corners = solid.vertices @ turn.T + position
                low, high = corners.min(0), corners.max(0)
                parts.append(Part(shape, corners, low, high, friction, up))
        return parts

    def _place(self, body: int, frame: int) -> tuple[F64, F64]:
        track = self._episode.tracks[self._episode.header.bodies[body].name]
        at = frame if len(track) > 1 else 0
        return track.position[at].astype(np.float64), matrix(track.orientation[at : at + 1])[0]

    def _normal(self, first: int, second: int, x: Part, y: Part, frame: int) -> F64 | None:
        """Unit, from the first geom to the second, if they are within ``NEAR``: where it grows."""
        names = [self._episode.header.bodies[b].name for b in (first, second)]
        tracks = [self._episode.tracks[name] for name in names]
        (p, q), (r, s) = (
            (t.position[at], t.orientation[at])
            for t in tracks
            for at in [frame if len(t) > 1 else 0]
        )
        steps = np.concatenate([np.zeros((1, 3)), PROBE * np.eye(3), -PROBE * np.eye(3)])
        moving = Mover.build(y.shape, r.astype(np.float64) + steps, np.tile(s, (7, 1)))
        apart = clearance_series([Mover.build(x.shape, p, q)], [moving], 0.05, deep=True)
        gap = (apart.lower + apart.upper) / 2
        if not np.isfinite(gap).all() or gap[0] > NEAR or gap[0] < -DEEP:
            return None
        slope = gap[1:4] - gap[4:]
        size = np.linalg.norm(slope)
        return None if size < PROBE / 2 else np.asarray(slope / size)


def _common(x: Part, y: Part, normal: F64) -> F64:
    """(P, 3) m, corners of where the two sides that face each other overlap."""
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    axes = np.stack([u, np.cross(normal, u)])
    sides, level = [], []
    for part, sign in ((x, 1.0), (y, -1.0)):
        if part.corners is None:
            continue
        along = sign * (part.corners @ normal)
        side = part.corners[along >= along.max() - _play(part, normal)]
        sides.append(side @ axes.T)
        level.append(float((side @ normal).mean()))
    if not sides:
        return np.zeros((0, 3))
    flat = _hull(sides[0])
    if len(sides) == 2:
        flat = _clipped(_fewer(flat), _fewer(_hull(sides[1])))
    if not len(flat):
        return np.zeros((0, 3))
    return np.asarray(flat @ axes + np.mean(level) * normal)


def _play(part: Part, normal: F64) -> float:
    """How far (m) behind the foremost a corner still touches: a round side rolls on one line."""
    kind = part.shape.geoms[0].kind
    round_ = kind in ("sphere", "ellipsoid", "capsule")
    if kind == "cylinder":
        round_ = abs(float(part.axis @ normal)) < 0.7
    return ROLLS if round_ else NEAR


def _fewer(outline: F64) -> F64:
    """The outline with at most ``CORNERS`` of its corners: enough to stand on."""
    if len(outline) <= CORNERS:
        return outline
    return outline[np.arange(CORNERS) * len(outline) // CORNERS]


def _hull(points: F64) -> F64:
    """(H, 2) convex hull, counter-clockwise; Andrew's monotone chain."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    halves = []
    for run in (ordered, ordered[::-1]):
        chain: list[F64] = []
        for p in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 1e-12:
                chain.pop()
            chain.append(p)
        halves += chain[:-1] if len(chain) > 1 else []
    return np.array(halves) if halves else ordered[:1]


def _turn(a: F64, b: F64, c: F64) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _clipped(subject: F64, window: F64) -> F64:
    """What of a convex polygon, edge or point lies in another, which is widened by ``NEAR`` / 5.

    Sutherland & Hodgman 1974.
    """
    room = NEAR / 5
    if len(window) < 3:  # an edge or a point: as a narrow rectangle
        ends = window[[0, -1]]
        along = ends[1] - ends[0]
        size = float(np.hypot(*along))
        along = along / size if size > 0 else np.array([1.0, 0.0])
        across = np.array([-along[1], along[0]])
        window = np.array(
            [ends[0] - across * 1e-9, ends[1] - across * 1e-9, ends[1] + across * 1e-9,
             ends[0] + across * 1e-9]
        ) + np.array([-1, 1, 1, -1])[:, None] * 1e-9 * along  # fmt: skip
    points = list(subject)
    for a, b in zip(window, np.roll(window, -1, axis=0), strict=True):
        edge = b - a
        size = float(np.hypot(*edge))
        if size < 1e-12:
            continue
        inward = np.array([-edge[1], edge[0]]) / size
        heights = [float((p - a) @ inward) + room for p in points]
        kept = []
        for k, (p, h) in enumerate(zip(points, heights, strict=True)):
            following, other = points[(k + 1) % len(points)], heights[(k + 1) % len(points)]
            if h >= 0:
                kept.append(p)
            if (h >= 0) != (other >= 0):
                kept.append(p + (following - p) * (h / (h - other)))
        points = kept
        if not points:
            break
    return np.array(points).reshape(-1, 2)
