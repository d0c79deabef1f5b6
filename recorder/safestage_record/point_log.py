"""Contacts of simulators that list them as points: each frame's, with the peaks of the steps before."""

from __future__ import annotations

from typing import Any, Callable, Hashable, Sequence, Tuple

import numpy as np

from .zip_trace import CONTACT_POINT

Row = Tuple[Hashable, float, Any]
"""A contact: which pair of bodies touches (None: one of them is not in the trace), the normal force in N, and
what its point is made of."""


def pack_point(fields: Any) -> bytes:
    """One CONTACT_POINT of (position, normal, force, normal force, depth, geom1, geom2)."""
    return np.array([fields], CONTACT_POINT).tobytes()


def read_points(block: bytes) -> Any:
    """(C,) CONTACT_POINT of what ``pack_point`` made, one after the other."""
    return np.frombuffer(block, CONTACT_POINT).copy()


class PointLog:
    """Gathers contacts step by step: of a step between frames the largest forces, of a frame its points.

    Attributes:
        first: pairs that touched since the last frame, and what the point of the first row of each is made of.
        unrecorded: contacts of shapes that the trace does not have.
    """

    def __init__(
        self,
        pack: Callable[[Any], bytes] = pack_point,
        read: Callable[[bytes], Any] = read_points,
    ) -> None:
        """Begin with no contact.

        Args:
            pack: bytes of what the point of a row is made of; the simulator's own objects take a kilobyte each.
            read: (C,) CONTACT_POINT of many of these, one after the other.
        """
        self._pack, self._read = pack, read
        self._largest: dict[Hashable, float] = {}
        self.first: dict[Hashable, Any] = {}
        self._packed: list[bytes] = []
        self._peaks: list[float] = []
        self._without_force: list[int] = []
        self._counts: list[int] = []
        self.unrecorded = 0

    def take(self, rows: Sequence[Row]) -> dict[Hashable, float]:
        """Take the contacts of a step; return N, the normal force of each pair."""
        largest, first = self._largest, self.first
        sums: dict[Hashable, float] = {}
        for pair, size, point in rows:
            if pair in sums:
                sums[pair] += size
            else:
                sums[pair] = size
                if pair not in first:
                    first[pair] = point
        if None in sums:
            self.unrecorded += sum(row[0] is None for row in rows)
            del sums[None], first[None]
        for pair, size in sums.items():
            if size > largest.get(pair, -1.0):
                largest[pair] = size
        return sums

    def end_frame(self, rows: Sequence[Row]) -> None:
        """Take the contacts of a frame, which ends with it.

        A pair that touched between two frames only has one row, without force.
        """
        own, before = self.take(rows), len(self._packed)
        packed, peaks, largest, pack = self._packed, self._peaks, self._largest, self._pack
        for pair, _, point in rows:
            if pair is not None:
                packed.append(pack(point))
                peaks.append(largest[pair])
        if len(self.first) > len(own):
            for pair, point in self.first.items():
                if pair not in own:
                    self._without_force.append(len(packed))
                    packed.append(pack(point))
                    peaks.append(largest[pair])
        self._counts.append(len(packed) - before)
        largest.clear()
        self.first.clear()

    def finish(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of the frames since the last call, and (T,) how many each has."""
        points = self._read(b"".join(self._packed))
        points["peak_force"] = self._peaks
        points["force"][self._without_force] = 0.0
        counts = np.array(self._counts, np.int64)
        self._packed, self._peaks, self._without_force, self._counts = [], [], [], []
        return points, counts
