"""The contacts of a sketch: of bodies that stand, that are held, or that the story says touch."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, ContactTable
from safestage_eval.geometry.pose import matrix

from . import hand
from .hand import Visit
from .paths import Paths
from .resting import Resting, Row
from .sketch_model import Hold, Reach, Touch
from .solids import AXES

F64 = NDArray[np.float64]

GRIP_HEIGHT = 0.75
"""Default height of a grip, as a share of the body's height."""


class Forces:
    """All contacts, and the stays of the gripper that they need.

    Attributes:
        visits: the gripper's stays, in the order of time.
        clash: a step that wants the gripper where it cannot be, if any.
    """

    def __init__(self, paths: Paths, steps: Sequence[Hold | Touch | Reach]) -> None:
        """``paths`` must be final: contacts go with the bodies."""
        self.paths = paths
        self._resting = Resting(paths.solids)
        self._touches = [(s, self._touched(s)) for s in steps if isinstance(s, Touch)]
        self._holds = [(s, self._held(s)) for s in steps if isinstance(s, Hold)]
        stays: list[tuple[Hold | Touch | Reach, Visit]] = [*self._holds]
        stays += [(s, self._beside(s, p)) for s, p in self._touches if s.by == "gripper"]
        stays += [(s, self._reached(s)) for s in steps if isinstance(s, Reach)]
        stays.sort(key=lambda stay: stay[1].first)
        self.visits = [visit for _, visit in stays]
        clashes = [b[0] for a, b in pairwise(stays) if b[1].first < a[1].last - 1e-9]
        self.clash = clashes[0] if clashes else None

    def table(self, bodies: Sequence[Body]) -> ContactTable:
        """The contact table; ``bodies`` in the header's order."""
        index = {body.name: i for i, body in enumerate(bodies)}
        first = dict(zip(index, np.cumsum([0] + [len(b.geoms) for b in bodies])[:-1], strict=True))
        rows = [(frame, row) for frame in range(len(self.paths.t)) for row in self.at(frame)]
        pair: dict[tuple[int, frozenset[str]], float] = {}
        for frame, row in rows:
            key = frame, frozenset((row.by, row.on))
            pressed = abs(float(row.force @ row.normal)) if row.peak is None else row.peak
            pair[key] = pair.get(key, 0.0) + pressed
        return ContactTable.build(
            [frame for frame, _ in rows],
            [index[row.by] for _, row in rows],
            [index[row.on] for _, row in rows],
            [first[row.by] + row.part_by for _, row in rows],
            [first[row.on] + row.part_on for _, row in rows],
            np.array([row.point for _, row in rows]).reshape(-1, 3),
            np.array([row.normal for _, row in rows]).reshape(-1, 3),
            np.array([row.force for _, row in rows]).reshape(-1, 3),
            [pair[frame, frozenset((row.by, row.on))] for frame, row in rows],
            [0.0] * len(rows),
        )

    def at(self, frame: int) -> list[Row]:
        """All contacts at a frame."""
        pushes = self._pushes(frame)
        poses = {name: self.paths.pose(name, frame) for name in self.paths.solids}
        standing, hanging = self._resting.at(poses, pushes)
        return [*standing, *pushes, *self._grips(frame, hanging)]

    def _during(self, span: tuple[float, float], frame: int) -> bool:
        time = self.paths.t[frame]
        return bool(span[0] - 1e-9 <= time <= span[1] + 1e-9)

    def _until(self, span: tuple[float, float]) -> tuple[float, float]:
        return span[0], min(span[1], float(self.paths.t[-1]))

    def _reach(self, name: str, frame: int) -> dict[str, float]:
        """Side → m, how far a body reaches that way from its origin."""
        rotation = matrix(self.paths.orientation[name][frame])
        parts = [p for p in self.paths.solids[name].shape.polytopes if p is not None]
        points = np.concatenate([part.vertices for part in parts]) @ rotation.T
        return {side: float((points @ way).max()) for side, way in AXES.items()}

    def _going_along(self, name: str, frame: int, point: F64) -> tuple[F64, F64]:
        return hand.carried_along(
            self.paths.position[name], self.paths.orientation[name], frame, point
        )

    def _held(self, hold: Hold) -> Visit:
        frame = self.paths.frame(hold.during[0])
        reach = self._reach(hold.hold, frame)
        height = hold.height
        if height is None:
            height = GRIP_HEIGHT * (reach["+z"] + reach["-z"]) - reach["-z"]
        left, right = reach[f"+{hold.across}"], reach[f"-{hold.across}"]
        middle = (left - right) / 2 * AXES[f"+{hold.across}"]
        point = self.paths.position[hold.hold][frame] + [0, 0, height] + middle
        place, turned = self._going_along(hold.hold, frame, point)
        return Visit(*self._until(hold.during), place, turned, (left + right) / 2, hold.across)

    def _touched(self, touch: Touch) -> F64:
        """(T, 3) m: the touched point, going with the touched body."""
        frame = self.paths.frame(touch.during[0])
        if touch.at is not None:
            offset = np.array(touch.at)
        else:
            reach = np.array(list(self._reach(touch.touch, frame).values()))
            offset = (reach[::2] - reach[1::2]) / 2
            offset += (reach[::2] + reach[1::2]) / 2 * AXES[touch.side]
        point = self.paths.position[touch.touch][frame] + offset
        return self._going_along(touch.touch, frame, point)[0]

    def _beside(self, touch: Touch, point: F64) -> Visit:
        """The closed gripper outside the touched point."""
        out = AXES[touch.side]
        room = np.array([hand.FINGER[0], 2 * hand.FINGER[1], 0.01])
        still = np.tile([1.0, 0, 0, 0], (len(point), 1))
        return Visit(*self._until(touch.during), point + out * (np.abs(out) @ room), still, 0.0)

    def _reached(self, reach: Reach) -> Visit:
        frames = len(self.paths.t)
        still = np.tile([1.0, 0, 0, 0], (frames, 1))
        return Visit(*self._until(reach.during), np.tile(reach.reach, (frames, 1)), still, 0.02)

    def _pushes(self, frame: int) -> list[Row]:
        rows = []
        for touch, point in self._touches:
            if not self._during(touch.during, frame):
                continue
            inward = -AXES[touch.side]
            strength = touch.force
            force = strength * inward if isinstance(strength, float) else np.array(strength)
            by = "finger_left" if touch.by == "gripper" else touch.by
            rows.append(Row(by, touch.touch, point[frame], inward, force, peak=touch.peak))
        return rows

    def _grips(self, frame: int, hanging: dict[str, float]) -> list[Row]:
        """The fingers on what is held; off the ground they bear it by friction."""
        rows = []
        for hold, visit in self._holds:
            if not self._during(hold.during, frame):
                continue
            way = matrix(visit.orientation[frame]) @ AXES[f"+{hold.across}"]
            borne = np.array([0, 0, hanging.get(hold.hold, 0.0) / 2])
            for name, sign in (("finger_left", 1.0), ("finger_right", -1.0)):
                point = visit.position[frame] + sign * visit.opening * way
                force = -sign * hold.grip * way + borne
                rows.append(Row(name, hold.hold, point, -sign * way, force))
        return rows
