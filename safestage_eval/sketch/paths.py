"""Poses of every body at every frame: the story's moves, turns and falls in order."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.pose import product, rotate

from .sketch_model import Drop, Move, Roll, Step, Tip, Turn
from .solids import AXES, Solid, ground

F64 = NDArray[np.float64]

GRAVITY = 9.81


class Paths:
    """Poses of all bodies over T frames.

    Attributes:
        t: (T,) s.
        position: body → (T, 3) m, body frame's origin, world.
        orientation: body → (T, 4) wxyz, body frame to world.
    """

    def __init__(
        self, t: F64, solids: Mapping[str, Solid], start: Mapping[str, tuple[F64, F64]]
    ) -> None:
        """Everything rests where it starts."""
        self.t, self.solids = t, solids
        self.position = {n: np.tile(start[n][0], (len(t), 1)) for n in solids}
        self.orientation = {n: np.tile(start[n][1], (len(t), 1)) for n in solids}

    def pose(self, name: str, frame: int) -> tuple[F64, F64]:
        """A body's pose at a frame: position (3,) m and orientation (4,) wxyz, world."""
        return self.position[name][frame], self.orientation[name][frame]

    def frame(self, time: float) -> int:
        """The first frame at or after a time; the last one if there is none."""
        return min(int(np.searchsorted(self.t, time - 1e-9)), len(self.t) - 1)

    def carry_out(self, step: Step) -> None:
        """Change the poses from the step's beginning on; steps come in the order they begin."""
        if isinstance(step, Move):
            way = np.array(step.by or (0.0, 0.0, 0.0))
            if step.to is not None:
                way = np.array(step.to) - self.pose(step.move[0], self.frame(step.during[0]))[0]
            self._shift(step.move, step.during, way)
        elif isinstance(step, Roll):
            way = np.array(step.by)
            frame = self.frame(step.during[0])
            bottom = self.solids[step.roll].bottom(self.pose(step.roll, frame))
            height = self._centre(step.roll, frame)[frame, 2] - bottom[:, 2].min()
            axis = np.cross([0, 0, 1.0], way)
            self._shift((step.roll,), step.during, way)
            self._turn((step.roll,), step.during, axis / np.linalg.norm(axis),
                       float(np.linalg.norm(way) / height), self._centre)  # fmt: skip
        elif isinstance(step, Turn):
            self._turn(step.turn, step.during, AXES[f"+{step.about}"], step.by, self._centre)
        elif isinstance(step, Tip):
            toward = AXES[step.toward]
            bottom = self.solids[step.tip[0]].bottom(
                self.pose(step.tip[0], self.frame(step.during[0]))
            )
            edge = bottom[bottom @ toward >= (bottom @ toward).max() - 1e-6].mean(0)
            offset = edge - self.position[step.tip[0]][self.frame(step.during[0])]
            self._turn(step.tip, step.during, np.cross([0, 0, 1.0], toward), step.by,
                       lambda name, _: self.position[name] + offset)  # fmt: skip
        elif isinstance(step, Drop):
            self._fall(step)

    def _shift(self, names: tuple[str, ...], during: tuple[float, float], way: F64) -> None:
        for name in names:
            self.position[name] += self._progress(during)[:, None] * way

    def _turn(
        self,
        names: tuple[str, ...],
        during: tuple[float, float],
        axis: F64,
        angle: float,
        pivot: Callable[[str, int], F64],
    ) -> None:
        frame = self.frame(during[0])
        centre = np.array(np.broadcast_to(pivot(names[0], frame), (len(self.t), 3)))
        half = self._progress(during)[:, None] * angle / 2
        q = np.concatenate([np.cos(half), np.sin(half) * axis], 1)
        for name in names:
            self.position[name] = centre + rotate(q, self.position[name] - centre)
            self.orientation[name] = product(q, self.orientation[name])

    def _centre(self, name: str, frame: int) -> F64:
        """(T, 3) m, world: the centre of mass, as if the body kept its orientation of a frame."""
        com = rotate(self.orientation[name][frame], np.array(self.solids[name].body.com))
        return np.asarray(self.position[name] + com)

    def _fall(self, step: Drop) -> None:
        frame = self.frame(step.at)
        low = self.solids[step.drop].bottom(self.pose(step.drop, frame))[:, 2].min()
        far = step.by
        if far is None:
            faces = [
                face
                for name, solid in self.solids.items()
                if name != step.drop and solid.body.kind not in ("gripper", "region")
                for face in solid.faces(self.pose(name, frame))
            ]
            level = ground(faces, self.position[step.drop][frame, :2], low + 1e-6)
            if level is None:
                raise ValueError(f"{step.drop} has nothing beneath it to fall on; say by how much")
            far = low - level
        after = np.clip(self.t - step.at, 0, None)
        self.position[step.drop][:, 2] -= np.minimum(GRAVITY * after**2 / 2, far)

    def _progress(self, during: tuple[float, float]) -> F64:
        """(T,) 0 before the span, 1 after it, even in between."""
        first, last = during[0], min(during[1], float(self.t[-1]))
        if last <= first:
            return np.asarray(self.t >= first - 1e-9, np.float64)
        return np.asarray(np.clip((self.t - first) / (last - first), 0, 1))
