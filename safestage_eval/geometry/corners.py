"""The corner of a hull that is farthest in a direction, for many directions at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

FEW = 256
"""Corners of a hull up to which all are compared; larger hulls are searched."""

CELLS = 16
"""Directions are sorted into so many by so many cells on each side of a cube around the hull."""

FUZZ = 1e-12
"""m. Corners that rounding may make the farthest ones are candidates too."""


class Corners:
    """Points (V, 3) m whose hull is meant."""

    def __init__(self, points: F64) -> None:
        self.points = points
        self._found: dict[int, F64] = {}

    def __len__(self) -> int:
        """V."""
        return len(self.points)

    def farthest(self, direction: F64) -> F64:
        """(N, 3) the points that are farthest along directions (N, 3)."""
        if len(self.points) <= FEW:
            return np.asarray(self.points[(direction @ self.points.T).argmax(1)])
        every = np.arange(len(direction))
        axis = np.abs(direction).argmax(1)
        ahead = direction[every, axis]
        scale = CELLS / 2 / np.maximum(np.abs(ahead), 1e-300)
        cell = 2 * axis + (ahead < 0)
        for beside in (1, 2):
            at = (direction[every, (axis + beside) % 3] * scale + CELLS / 2).astype(np.int64)
            cell = cell * CELLS + np.minimum(at, CELLS - 1)
        order = np.argsort(cell, kind="stable")
        starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
        out = np.empty((len(direction), 3))
        for rows in np.split(order, starts[1:]) if len(order) else ():
            some = self._candidates(int(cell[rows[0]]))
            out[rows] = some[(direction[rows] @ some.T).argmax(1)]
        return out

    def _candidates(self, cell: int) -> F64:
        """(K, 3) all points that are the farthest in some direction of a cell."""
        if cell not in self._found:
            side, u, v = cell // CELLS**2, cell // CELLS % CELLS, cell % CELLS
            axis = side // 2
            way = np.roll([1.0 - 2 * (side % 2), *((2 * x + 1) / CELLS - 1 for x in (u, v))], axis)
            along = self.points @ way
            top = int(along.argmax())
            off = np.abs(self.points - self.points[top])
            gain = (
                off.sum(1) - off[:, axis]
            ) / CELLS  # in the direction of the cell that suits most
            self._found[cell] = self.points[along + gain + FUZZ >= along[top]]
        return self._found[cell]
