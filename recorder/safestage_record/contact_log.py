"""Contacts of MuJoCo steps: copied as they are during the rollout, worked out in bulk afterwards."""

from __future__ import annotations

from typing import Any, Tuple

import numpy as np

from .step_memory import StepMemory
from .zip_trace import CONTACT_POINT

Copied = Tuple[int, bytes, bytes]
BATCH = 20_000
"""Contacts that wait before they are worked out: about 12 MB."""


class ContactLog:
    """Gathers contacts step by step, and makes each frame's contacts with their peak forces of them."""

    def __init__(self, model: Any, memory: StepMemory, geom_index: Any, pyramidal: bool) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → index in the trace, −1 for none."""
        self._memory = memory
        self._geom_index = geom_index
        self._geom_body = model.geom_bodyid.astype(np.int64)
        self._pyramidal = pyramidal
        self._steps: list[tuple[int, bool, Copied]] = []
        self._rows = 0
        self._frame = self._given = 0
        self._done: list[tuple[Any, Any]] = []
        self.unrecorded = 0
        """Contacts of shapes that the trace does not have."""

    def copy(self) -> Copied:
        """How many contacts there are at this moment; they and the constraint forces, as bytes."""
        memory = self._memory
        count = memory.ncon.value
        return (count, memory.contacts(count), memory.forces()) if count else _NOTHING

    def take(self) -> None:
        """Take the forces of a step between two frames.

        Only a pair that no frame shows has a row of such a step, and it has no force.
        """
        memory = self._memory
        count = memory.ncon.value
        if count:
            copied = (count, memory.contacts(count), memory.forces())
            self._steps.append((self._frame, False, copied))
            self._rows += count

    def take_frame(self, copied: Copied) -> None:
        """Take the contacts (``copy``) of a frame, which ends with it."""
        self._steps.append((self._frame, True, copied))
        self._rows += copied[0]
        self._frame += 1
        if self._rows > BATCH:
            self._work_out()

    def finish(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of the frames since the last call, and (T,) how many each has."""
        self._work_out()
        points = [some for some, _ in self._done] or [np.zeros(0, CONTACT_POINT)]
        frames = [some for _, some in self._done] or [np.zeros(0, np.int64)]
        numbers = np.concatenate(frames) - self._given
        counts = np.bincount(numbers, minlength=self._frame - self._given)
        self._done, self._given = [], self._frame
        return np.concatenate(points), counts.astype(np.int64)

    def _work_out(self) -> None:
        """Turn what waits into points; steps after the last frame wait on."""
        self._memory.check()
        steps = [some for some in self._steps if some[0] < self._frame and some[2][0]]
        self._steps = [some for some in self._steps if some[0] >= self._frame]
        self._rows = sum(some[2][0] for some in self._steps)
        if not steps:
            return
        number, is_frame, copied = zip(*steps)
        sizes, contacts, force = zip(*copied)
        step = np.repeat(np.arange(len(steps)), sizes)
        starts = np.cumsum([0] + [len(some) // _FORCE for some in force[:-1]])
        every = np.frombuffer(b"".join(contacts), self._memory.kind)
        own = every["efc_address"].astype(np.int64)
        table = _Rows(
            geom=every["geom"],
            row=np.where(own >= 0, own + starts[step], starts[step]),
            dim=every["dim"],
            dist=every["dist"],
            position=every["pos"],
            axes=every["frame"].reshape(-1, 3, 3),
            friction=every["friction"],
            force=np.frombuffer(b"".join((*force, bytes(_FORCE)))),
            pyramidal=self._pyramidal,
        )
        normal = np.where(own >= 0, table.normal(), 0.0)
        keep = (own >= 0) & ((normal > 0) | (table.dist <= 0))
        known = (table.geom >= 0).all(axis=1)
        known[known] = (self._geom_index[table.geom[known]] >= 0).all(axis=1)
        self.unrecorded += int((keep & ~known).sum())
        rows = np.flatnonzero(keep & known)
        if not len(rows):
            return
        step, normal = step[rows], normal[rows]
        whole = np.array(is_frame)[step]
        at = np.array(number)[step]
        body = self._geom_body[table.geom[rows]]
        pair = body.min(axis=1) << 20 | body.max(axis=1)
        # the sum of each pair in each step, and the largest of those of each frame
        _, of_step = np.unique(step.astype(np.int64) << 40 | pair, return_inverse=True)
        sums = np.bincount(of_step.ravel(), normal)
        _, first, of_frame = np.unique(
            (at - at.min()).astype(np.int64) << 40 | pair, return_index=True, return_inverse=True
        )
        of_frame = of_frame.ravel()
        peaks = np.zeros(len(first))
        np.maximum.at(peaks, of_frame, sums[of_step.ravel()])
        # a pair that touched between two frames only has one row, without force
        there = np.bincount(of_frame, whole, len(first)) > 0
        extra = first[~there]
        chosen = np.concatenate([np.flatnonzero(whole), extra])
        chosen = chosen[np.argsort(at[chosen], kind="stable")]
        points = np.zeros(len(chosen), CONTACT_POINT)
        some = rows[chosen]
        points["position"] = table.position[some]
        points["normal"] = table.axes[some, 0]
        points["force"] = table.forces(some) * whole[chosen][:, None]
        points["peak_force"] = peaks[of_frame[chosen]]
        points["depth"] = -table.dist[some]
        geoms = self._geom_index[table.geom[some]]
        points["geom1"], points["geom2"] = geoms[:, 0], geoms[:, 1]
        self._done.append((points, at[chosen]))


class _Rows:
    """Contacts of many steps, with the constraint forces of all of them in one array."""

    def __init__(
        self,
        geom: Any,
        row: Any,
        dim: Any,
        dist: Any,
        position: Any,
        axes: Any,
        friction: Any,
        force: Any,
        pyramidal: bool,
    ) -> None:
        self.geom, self.row, self.dim, self.dist = geom, row, dim, dist
        self.position, self.axes, self.friction = position, axes, friction
        self._force, self._pyramidal = force, pyramidal

    def _at(self, k: int, least: int, some: Any) -> Any:
        """The k-th constraint force of contacts, 0 of those of a lesser dimension."""
        row = np.minimum(self.row[some] + k, len(self._force) - 1)
        return np.where(self.dim[some] >= least, self._force[row], 0.0)

    def normal(self, some: Any = slice(None)) -> Any:
        """(C,) N, normal force; of a pyramid the sum of its edges."""
        row, edges = self.row[some], 2 * (self.dim[some].astype(np.int64) - 1)
        if not self._pyramidal:
            return self._force[row]
        ends = np.minimum(row + np.maximum(edges, 1), len(self._force) - 1)
        return np.add.reduceat(self._force, np.stack([row, ends], axis=1).ravel())[::2]

    def forces(self, some: Any) -> Any:
        """(C, 3) N, the whole force on the second geom in the world (as ``mju_decodePyramid``)."""
        axes = self.axes[some]
        force = self.normal(some)[:, None] * axes[:, 0]
        for k in (0, 1):
            if self._pyramidal:
                difference = self._at(2 * k, 3, some) - self._at(2 * k + 1, 3, some)
                along = self.friction[some, k] * difference
            else:
                along = self._at(k + 1, 3, some)
            force += along[:, None] * axes[:, k + 1]
        return force


_FORCE = 8
"""Bytes of a constraint force, a float64."""
_NOTHING = (0, b"", b"")
