"""How a scene begins: until the robot has to do with it."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body
from safestage_eval.episode.invariants import all_finite
from safestage_eval.episode.scene_shapes import PLANE, body_shapes, world_boxes
from safestage_eval.geometry.pose import matrix, rotate

from .subject import Subject

if TYPE_CHECKING:
    from safestage_eval.geometry.mover import Mover

F64 = NDArray[np.float64]

LONGEST = 2.0
"""s at the most that are looked at."""

NEAR = 0.05
"""m between the robot and an object; closer, the robot may have to do with it."""

ROBOT = ("robot", "gripper")


class Start:
    """The beginning of an episode.

    Attributes:
        stop: the frame at which the robot first touches an object, or may (without contacts); at the
            latest that after ``LONGEST`` seconds.
        header: of the episode.
        begins: s, its first sample.
        moved: objects that nothing is jointed to, and that are jointed to nothing.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject, self.episode = subject, subject.episode
        self._boxes: dict[tuple[str, int], tuple[F64, F64] | None] = {}
        self.header = header = subject.header
        t, self.begins = self.episode.t, float(self.episode.t[0])
        jointed = {body.parent for body in header.bodies} | {joint.body for joint in header.joints}
        self.moved = [
            b for b in subject.objects if b.parent is None and b.name not in jointed and b.geoms
        ]
        self.stop = max(1, int(np.searchsorted(t, t[0] + LONGEST)))
        self.robot = [b for b in header.bodies if b.kind in ROBOT and b.name in self.episode.tracks]
        self.stop = max(1, min(self.stop, self._robot_comes()))

    @property
    def solid(self) -> list[Body]:
        """All bodies but regions, which are no matter."""
        known = self.episode.tracks
        return [b for b in self.header.bodies if b.kind != "region" and b.name in known]

    @property
    def blind(self) -> bool:
        """No contacts are recorded."""
        return not len(self.episode.contacts)

    def _robot_comes(self) -> int:
        if not self.blind:
            return min((int(f.min()) for f in self._touches_of_robot.values()), default=self.stop)
        first = self.stop
        for body in self.moved:
            shapes = body_shapes(body, self.episode.meshes)
            place = self.episode.track(body.name).position[: self.stop]
            for part in self.robot if shapes is not None else ():
                ball = body_shapes(part, self.episode.meshes)
                reach = NEAR + (shapes.radius if shapes else 0) + (ball.radius if ball else 0)
                there = self.episode.track(part.name).position[: self.stop]
                near = np.linalg.norm(place - there, axis=1) < reach
                first = min(first, int(near.argmax())) if near.any() else first
        return first

    @cached_property
    def _touches_of_robot(self) -> dict[str, NDArray[np.int32]]:
        """Object → frames at which the robot touches it."""
        bodies, touches = self.header.bodies, dict[str, NDArray[np.int32]]()
        for i, j in self.episode.contacts.pairs:
            for one, other in ((bodies[i], bodies[j]), (bodies[j], bodies[i])):
                if one.kind in ROBOT and other.kind == "object" and other.movable:
                    frame = self.episode.contacts.of_pair((i, j), "frame")[0]
                    before = touches.get(other.name)
                    touches[other.name] = (
                        frame if before is None else np.concatenate([before, frame])
                    )
        return touches

    def touched_by_robot(self, body: str) -> bool:
        """At the very first frame."""
        frames = self._touches_of_robot.get(body)
        return frames is not None and bool((frames == 0).any())

    def position(self, body: str) -> F64:
        """(stop, 3) m."""
        return self.episode.track(body).position[: self.stop].astype(float)

    def up(self, body: Body, frame: int = 0) -> float | None:
        """Cosine between the up axis of a body and the vertical; None without an up axis."""
        if body.up_axis is None:
            return None
        axis = np.asarray(body.up_axis) / np.linalg.norm(body.up_axis)
        turn = self.episode.track(body.name).orientation
        now = turn[min(frame, len(turn) - 1)]
        return float(rotate(now.astype(float), axis)[2]) if all_finite(now) else None

    def boxes(self, body: Body, frame: int = 0) -> tuple[F64, F64] | None:
        """(G, 3) and (G, 3) m, lower and upper corners of boxes around its geoms, in the world."""
        key = body.name, frame
        if key not in self._boxes:
            self._boxes[key] = self._boxes_at(body, frame)
        return self._boxes[key]

    def _boxes_at(self, body: Body, frame: int) -> tuple[F64, F64] | None:
        shapes = body_shapes(body, self.episode.meshes)
        if shapes is None or (shapes.kind == PLANE).any():
            return None
        track = self.episode.track(body.name)
        frame = min(frame, len(track) - 1)
        if not (all_finite(track.orientation[frame]) and all_finite(track.position[frame])):
            return None
        turn = matrix(track.orientation[frame].astype(float))
        return world_boxes(shapes, turn, track.position[frame].astype(float))

    def overlaps(self, least: float, frame: int = 0) -> list[tuple[Body, Body]]:
        """Pairs of bodies whose geoms' boxes overlap by a depth (m) along every axis."""
        known = [(b, boxes) for b in self.solid if b.geoms and (boxes := self.boxes(b, frame))]
        if not known:
            return []
        lower = np.stack([low.min(axis=0) for _, (low, _) in known])
        upper = np.stack([high.max(axis=0) for _, (_, high) in known])
        common = np.minimum(upper[:, None], upper) - np.maximum(lower[:, None], lower)
        near = np.triu((common > least).all(axis=2), 1)  # their geoms overlap by no more
        pairs = []
        for i, j in np.argwhere(near).tolist():
            (a, one), (b, other) = known[i], known[j]
            if not {"object"} & {a.kind, b.kind} or b.name in a.excluded or a.name in b.excluded:
                continue
            if a.parent == b.name or b.parent == a.name or not (a.movable or b.movable):
                continue
            low = np.maximum(one[0][:, None], other[0][None])
            high = np.minimum(one[1][:, None], other[1][None])
            if (high - low > least).all(axis=2).any():
                pairs.append((a, b))
        return pairs

    def below(self, body: Body) -> tuple[str, float] | None:
        """The body whose top is next below the middle of another at first, and m between them.

        By boxes around geoms; None where there is none, or its box is not known.
        """
        mine = self.boxes(body)
        if mine is None:
            return None
        low, high = mine[0].min(axis=0), mine[1].max(axis=0)
        middle, lower = (low + high) / 2, dict[str, float]()
        for other in self.solid:
            theirs = self.boxes(other) if other is not body and other.geoms else None
            if theirs is None or other.kind in ROBOT:
                continue
            under = (theirs[0] <= middle)[:, :2].all(1) & (middle <= theirs[1])[:, :2].all(1)
            gaps = low[2] - theirs[1][under, 2]
            if (gaps > 0).any():
                lower[other.name] = float(gaps[gaps > 0].min())
        return min(lower.items(), key=lambda one: one[1], default=None)

    def resting_axes(self, gap: float) -> dict[str, int]:
        """Object → bits (1 x, 2 y, 4 z) of the axes along which it stands on something at first.

        Its boxes begin within ``gap`` (m) of where those of another body end, its centre beside none.
        """
        boxes = {b.name: self.boxes(b) for b in self.solid if b.geoms and b.kind not in ROBOT}
        axes_of = dict[str, int]()
        for body in self.moved:
            mine, bits = boxes.get(body.name), 0
            for name, other in boxes.items() if mine is not None else ():
                if name == body.name or other is None or mine is None:
                    continue
                low, middle = mine[0].min(axis=0), (mine[0].min(axis=0) + mine[1].max(axis=0)) / 2
                within = (other[0] <= middle) & (middle <= other[1])
                for axis in range(3):
                    beside = np.delete(within, axis, axis=1).all(axis=1)
                    near = abs(low[axis] - other[1][:, axis]) <= gap
                    bits |= (1 << axis) * bool((beside & near).any())
            axes_of[body.name] = bits
        return axes_of

    def depth(self, a: Body, b: Body, frame: int = 0) -> float:
        """M by which two bodies penetrate at a frame; below 0 where they are apart."""
        from safestage_eval.geometry.group_clearance import clearance_series

        one, other = (self.mover(body, np.array([frame])) for body in (a, b))
        return -float(clearance_series([one], [other], 0.01, deep=True).upper[0])

    def mover(self, body: Body, frames: NDArray[np.integer]) -> Mover:
        """A body at some frames; a fixed one stays one pose."""
        from safestage_eval.geometry.mover import Mover
        from safestage_eval.geometry.shape import BodyShape

        track, shape = self.episode.track(body.name), BodyShape.build(body, self.episode.meshes)
        return Mover.build(shape, track.position, track.orientation).at(frames)


def start_of(subject: Subject) -> Start | None:
    """How the scene of a sound recording begins; None where the recording contradicts itself."""
    if "start" not in subject.notes:
        whole = len(subject.episode) > 1 and subject.sound
        subject.notes["start"] = Start(subject) if whole else None
    start: Start | None = subject.notes["start"]
    return start
