"""Contacts of MuJoCo steps: copied as they are during the rollout, worked out in bulk afterwards."""

from __future__ import annotations

from typing import Any, Tuple

import numpy as np

from .step_memory import StepMemory
from .zip_trace import CONTACT_POINT

Copied = Tuple[int, bytes, bytes]
BATCH = 1 << 21
"""Bytes of contacts that wait before they are worked out; more do not stay in a processor's cache."""


class ContactLog:
    """Gathers contacts step by step, and makes each frame's contacts with their peak forces of them."""

    def __init__(self, model: Any, memory: StepMemory, geom_index: Any, pyramidal: bool) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → index in the trace, −1 for none."""
        self._memory = memory
        self._geom_index = np.append(geom_index, -1)  # flexible bodies have the shape −1
        self._geom_body = model.geom_bodyid.astype(np.int64)
        self._pyramidal = pyramidal
        self._contacts, self._forces = _Store(), _Store()
        self._sizes: list[int] = []
        self._widths: list[int] = []
        self._ends: list[int] = []
        self._frame = self._given = 0
        self._done: list[tuple[Any, Any]] = []
        self.unrecorded = 0
        """Contacts of shapes that the trace does not have."""

    def copy(self) -> Copied:
        """How many contacts there are at this moment; they and the constraint forces, as bytes."""
        memory = self._memory
        count = memory.ncon.value
        if not count:
            return 0, b"", b""
        return count, memory.contacts(count).tobytes(), memory.forces().tobytes()

    def take(self) -> None:
        """Take the forces of a step between two frames.

        Only a pair that no frame shows has a row of such a step, and it has no force.
        """
        memory = self._memory
        count = memory.ncon.value
        if count:
            self._add(count, memory.contacts(count), memory.forces())

    def take_frame(self, copied: Copied | None = None) -> None:
        """Take the contacts of a frame, which ends with it: a ``copy``, or those that are now."""
        before = len(self._sizes)
        if copied is None:
            self.take()
        elif copied[0]:
            self._add(*copied)
        if len(self._sizes) == before:
            self._add(0, b"", b"")
        self._ends.append(len(self._sizes))
        self._frame += 1
        if self._contacts.used > BATCH:
            self._work_out()

    def finish(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of the frames since the last call, and (T,) how many each has."""
        self._memory.check()
        self._work_out()
        points = [some for some, _ in self._done] or [np.zeros(0, CONTACT_POINT)]
        frames = [some for _, some in self._done] or [np.zeros(0, np.int64)]
        numbers = np.concatenate(frames) - self._given
        counts = np.bincount(numbers, minlength=self._frame - self._given)
        self._done, self._given = [], self._frame
        return np.concatenate(points), counts.astype(np.int64)

    def _add(self, count: int, contacts: Any, forces: Any) -> None:
        self._sizes.append(count)
        self._widths.append(len(forces))
        self._contacts.add(contacts)
        self._forces.add(forces)

    def _work_out(self) -> None:
        """Turn what waits into points; steps after the last frame wait on."""
        if not self._ends:
            return
        ends = np.array(self._ends)
        sizes = np.array(self._sizes[: ends[-1]], np.int64)
        widths = np.array(self._widths[: ends[-1]], np.int64)
        del self._sizes[: ends[-1]], self._widths[: ends[-1]], self._ends[:]
        number = np.repeat(
            np.arange(self._frame - len(ends), self._frame), np.diff(ends, prepend=0)
        )
        is_frame = np.zeros(len(number), bool)
        is_frame[ends - 1] = True
        if sizes.any():
            self._make_points(number, is_frame, sizes, np.cumsum(widths) // _FORCE)
            self._contacts.drop(int(sizes.sum()) * self._memory.kind.itemsize)
            self._forces.drop(int(widths.sum()))

    def _make_points(self, number: Any, is_frame: Any, sizes: Any, ends: Any) -> None:
        """Make points of the contacts of steps.

        Args:
            number: (S,) the frame that each step belongs to, ascending.
            is_frame: (S,) whether the step is the frame's own.
            sizes: (S,) contacts of each step.
            ends: (S,) where the constraint forces of each step end.
        """
        many = int(sizes.sum())
        every = self._contacts.first(many, self._memory.kind)
        step = np.repeat(np.arange(len(sizes)), sizes)
        own = every["efc_address"].astype(np.int64)
        active = own >= 0
        table = _Rows(
            every,
            row=np.maximum(own, 0) + np.append(0, ends[:-1])[step],
            force=self._forces.first(int(ends[-1]) + 1, np.dtype(np.float64)),
            pyramidal=self._pyramidal,
        )
        normal = np.where(active, table.normal(), 0.0)
        keep = active & ((normal > 0) | (every["dist"] <= 0))
        first, second = self._geom_index[every["geom"].T]
        known = (first >= 0) & (second >= 0)
        self.unrecorded += int((keep & ~known).sum())
        rows = np.flatnonzero(keep & known)
        if not len(rows):
            return
        step, normal = step[rows], normal[rows]
        whole, at = is_frame[step], number[step]
        pair, peaks = self._pair_peaks(step, normal, every["geom"][rows].T, number)
        # a pair that touched between two frames only has one row, without force
        of_frame = (at - number[0]) * peaks.shape[1] + pair
        there = np.full(peaks.size, -1)
        there[of_frame[::-1]] = np.arange(len(rows))[::-1]  # the first of each pair
        there[of_frame[whole]] = -1
        extra = there[there >= 0]
        chosen = np.concatenate([np.flatnonzero(whole), extra])
        chosen = chosen[np.argsort(at[chosen], kind="stable")]
        points = np.zeros(len(chosen), CONTACT_POINT)
        some = rows[chosen]
        points["position"] = every["pos"][some]
        points["normal"] = every["frame"][some, :3]
        points["force"] = table.forces(some, normal[chosen]) * whole[chosen][:, None]
        points["peak_force"] = peaks.ravel()[of_frame[chosen]]
        points["depth"] = -every["dist"][some]
        points["geom1"], points["geom2"] = first[some], second[some]
        self._done.append((points, at[chosen]))

    def _pair_peaks(self, step: Any, normal: Any, geom: Any, number: Any) -> tuple[Any, Any]:
        """The pair of bodies of each contact, and each pair's largest force in a step of each frame.

        Args:
            step: (C,) number of the step, ascending.
            normal: (C,) N.
            geom: (2, C) MuJoCo's ids.
            number: (S,) number of the frame that each step belongs to, ascending.

        Returns:
            (C,) numbers of pairs from 0 on, and (F, P) N, frames from ``number[0]`` on.
        """
        first, second = self._geom_body[geom]
        code = np.minimum(first, second) * (int(self._geom_body.max()) + 1)
        code += np.maximum(first, second)
        there = np.bincount(code) > 0
        pair = (np.cumsum(there) - 1)[code]
        many = int(there.sum())
        sums = np.bincount(step * many + pair, normal, len(number) * many).reshape(-1, many)
        begins = np.flatnonzero(np.diff(number, prepend=-1))
        return pair, np.maximum.reduceat(sums, begins)


class _Rows:
    """Contacts of many steps, with the constraint forces of all of them in one array."""

    def __init__(self, every: Any, row: Any, force: Any, pyramidal: bool) -> None:
        """``every``: (C,) MuJoCo's contacts; ``row``: (C,) where the force of each begins."""
        self._every, self._row, self._dim = every, row, every["dim"].astype(np.int64)
        self._force, self._pyramidal = force, pyramidal

    def _at(self, k: int, least: int, some: Any) -> Any:
        """The k-th constraint force of contacts, 0 of those of a lesser dimension."""
        row = np.minimum(self._row[some] + k, len(self._force) - 1)
        return np.where(self._dim[some] >= least, self._force[row], 0.0)

    def normal(self) -> Any:
        """(C,) N, normal force; of a pyramid the sum of its edges."""
        row, edges = self._row, 2 * (self._dim - 1)
        if not self._pyramidal:
            return self._force[row]
        ends = np.minimum(row + np.maximum(edges, 1), len(self._force) - 1)
        return np.add.reduceat(self._force, np.stack([row, ends], axis=1).ravel())[::2]

    def forces(self, some: Any, normal: Any) -> Any:
        """(K, 3) N, the whole force on the second geom in the world (as ``mju_decodePyramid``)."""
        axes = self._every["frame"][some].reshape(-1, 3, 3)
        friction = self._every["friction"][some]
        force = normal[:, None] * axes[:, 0]
        for k in (0, 1):
            if self._pyramidal:
                difference = self._at(2 * k, 3, some) - self._at(2 * k + 1, 3, some)
                along = friction[:, k] * difference
            else:
                along = self._at(k + 1, 3, some)
            force += along[:, None] * axes[:, k + 1]
        return force


class _Store:
    """Bytes one after another, in memory that is used again."""

    def __init__(self) -> None:
        self._block = memoryview(bytearray(BATCH // 4))
        self.used = 0

    def add(self, some: Any) -> None:
        """Copy bytes to the end."""
        at = self.used
        end = at + len(some)
        if end + _FORCE > len(self._block):
            larger = memoryview(bytearray(2 * end + _FORCE))
            larger[:at] = self._block[:at]
            self._block = larger
        self._block[at:end] = some
        self.used = end

    def first(self, count: int, kind: Any) -> Any:
        """(count,) the first elements, where they lie; one more than there are may be asked for."""
        return np.frombuffer(self._block, kind, count)

    def drop(self, size: int) -> None:
        """Remove the first bytes."""
        rest = bytes(self._block[size : self.used])
        self._block[: len(rest)] = rest
        self.used = len(rest)


_FORCE = 8
"""Bytes of a constraint force, a float64."""
