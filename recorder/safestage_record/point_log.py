"""Contacts of simulators that list them as points: each frame's, with the peaks of the steps before."""

from __future__ import annotations

from typing import Any

import numpy as np

from .zip_trace import CONTACT_POINT


class PointLog:
    """Gathers contacts step by step, and makes each frame's contacts with their peak forces of them."""

    def __init__(self, owner: Any) -> None:
        """``owner``: (G,) body number of every shape, in the header's order."""
        self._owner = np.asarray(owner, np.int64)
        self._waiting: list[Any] = []
        self._frames: list[Any] = []

    def take(self, points: Any) -> None:
        """Take the contacts (C,) CONTACT_POINT of a step; ``peak_force`` is the normal force of each."""
        self._waiting.append(points)

    def drop_last(self) -> None:
        """Take back the last step, which is about to be a frame's."""
        if self._waiting:
            self._waiting.pop()

    def end_frame(self, points: Any) -> None:
        """Take the contacts of a frame, which ends with it.

        A pair that touched between two frames only has one row, without force.
        """
        steps = [*self._waiting, points]
        self._waiting = []
        every = np.concatenate(steps)
        step = np.repeat(np.arange(len(steps)), [len(some) for some in steps])
        first, second = self._owner[every["geom1"]], self._owner[every["geom2"]]
        pair = np.minimum(first, second) << 20 | np.maximum(first, second)
        _, rows, number = np.unique(pair, return_index=True, return_inverse=True)
        number = number.ravel()
        sums = np.zeros((len(steps), len(rows)))
        np.add.at(sums, (step, number), every["peak_force"])
        here = step == len(steps) - 1
        there = np.isin(np.arange(len(rows)), number[here])
        every = every.copy()
        every["peak_force"] = sums.max(axis=0)[number] if len(every) else 0.0
        extra = every[rows[~there]]
        extra["force"] = 0.0
        self._frames.append(np.concatenate([every[here], extra]))

    def finish(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of the frames since the last call, and (T,) how many each has."""
        frames, self._frames = self._frames, []
        counts = np.array([len(some) for some in frames], np.int64)
        return np.concatenate(frames or [np.zeros(0, CONTACT_POINT)]), counts


def contact_points(rows: list[tuple[Any, ...]]) -> Any:
    """(C,) CONTACT_POINT of (position, normal, force, normal force, depth, geom1, geom2)."""
    return np.array(rows, CONTACT_POINT)
