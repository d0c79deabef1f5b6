"""Contacts of simulators that list them as points: each frame's, with the peaks of the steps before."""

from __future__ import annotations

from typing import Any, Callable, Sequence

import numpy as np

from .frame_contacts import keep_contacts
from .zip_trace import CONTACT_POINT

NO_SHAPE = int(np.iinfo(np.uint16).max)
"""``geom1`` of a contact that the trace does not have, as one of its shapes is missing there."""


def contact_points(rows: Sequence[Any]) -> Any:
    """(C,) CONTACT_POINT of (position, normal, force, normal force, depth, geom1, geom2)."""
    return np.array(rows, CONTACT_POINT)


MANY = 256
"""Contacts that wait as the simulator's own objects, which take a kilobyte each."""


class PointLog:
    """Gathers contacts step by step, and makes each frame's contacts with their peak forces of them."""

    def __init__(self, owner: Any, read: Callable[[Sequence[Any]], Any] = contact_points) -> None:
        """Begin with no contact.

        Args:
            owner: (G,) body number of every shape, in the header's order.
            read: makes (C,) CONTACT_POINT of what ``take`` is given, one row for each; their
                ``peak_force`` is the normal force of each.
        """
        self._owner, self._read = np.asarray(owner, np.int64), read
        self._rows: list[Any] = []
        self._parts = [np.zeros(0, CONTACT_POINT)]
        self._sizes: list[int] = []
        self._ends: list[int] = []

    def take(self, rows: Sequence[Any]) -> None:
        """Take the contacts of a step, to be read later."""
        if len(self._rows) > MANY:
            self._read_rows()
        self._rows += rows
        self._sizes.append(len(rows))

    def drop_last(self) -> None:
        """Take back the last step, which is about to be a frame's."""
        if len(self._sizes) > (self._ends[-1] if self._ends else 0):
            count = self._sizes.pop()
            del self._rows[len(self._rows) - count :]

    def end_frame(self, rows: Sequence[Any]) -> None:
        """Take the contacts of a frame, which ends with it.

        A pair that touched between two frames only has one row, without force.
        """
        self.take(rows)
        self._ends.append(len(self._sizes))

    def finish(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of the frames since the last call, and (T,) how many each has."""
        if not self._ends:
            return np.zeros(0, CONTACT_POINT), np.zeros(0, np.int64)
        ends, self._ends = np.array(self._ends), []
        sizes = self._sizes[: ends[-1]]
        del self._sizes[: ends[-1]]
        step = np.repeat(np.arange(len(sizes)), sizes)
        self._read_rows()
        every = np.concatenate(self._parts)
        points, self._parts = every[: len(step)], [every[len(step) :]]
        there = np.flatnonzero(points["geom1"] != NO_SHAPE)
        points, step = points[there], step[there]
        if not len(points):
            return points, np.zeros(len(ends), np.int64)
        first, second = self._owner[points["geom1"]], self._owner[points["geom2"]]
        code = np.minimum(first, second) << 20 | np.maximum(first, second)
        pair = np.unique(code, return_inverse=True)[1].ravel()
        kept = keep_contacts(step, pair, points["peak_force"].astype(float), ends)
        points = points[kept.rows]
        points["force"] *= kept.own[:, None]
        points["peak_force"] = kept.peak
        return points, np.bincount(kept.frame, minlength=len(ends)).astype(np.int64)

    def _read_rows(self) -> None:
        self._parts.append(self._read(self._rows))
        self._rows = []
