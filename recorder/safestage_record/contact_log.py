"""Contacts of MuJoCo steps: copied as they are during the rollout, worked out in bulk afterwards."""

from __future__ import annotations

import io
from typing import Any, Callable

import numpy as np

from .frame_contacts import keep_contacts
from .step_memory import HEAD, StepMemory
from .zip_trace import CONTACT_POINT

BATCH = 1 << 21
"""Bytes of contacts that wait before they are worked out; more do not stay in a processor's cache."""
_NONE = HEAD.pack(0, 0)


class ContactLog:
    """Gathers contacts step by step, and makes each frame's contacts with their peak forces of them.

    Attributes:
        copy: copies contacts and forces as they are now.
        take: takes the forces of a step between two frames. Only a pair that no frame shows has a row of such
            a step, and it has no force.
        end_frame: says that a frame ends, with the step that was taken last or with these contacts.
        unrecorded: contacts of shapes that the trace does not have.
    """

    def __init__(self, model: Any, memory: StepMemory, geom_index: Any, pyramidal: bool) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → index in the trace, −1 for none."""
        self._memory = memory
        # flexible bodies have the shape −1; bodies of shapes that the trace lacks count as one
        self._geom_index = np.append(geom_index, -1)
        self._bodies = model.nbody + 1
        self._geom_body = np.append(model.geom_bodyid, 0).astype(np.int64)
        self._geom_body[self._geom_index < 0] = model.nbody
        self._pyramidal = pyramidal
        # Memory that is used again: what is allocated anew costs a page fault every 4 kB.
        self._block = io.BytesIO()
        self._write = self._block.write
        self._lengths: list[int] = []
        self._ends: list[int] = []
        self.copy = memory.copier()
        self.take, self.end_frame = self._taker(), self._ender()
        self._frame = self._given = 0
        self._done: list[tuple[Any, Any]] = []
        self._there: Any = ()
        self._number: Any = None
        self.unrecorded = 0

    def _taker(self) -> Callable[[], None]:
        copy, write, add = self.copy, self._write, self._lengths.append

        def take() -> None:
            step = copy()
            if step:
                add(write(step))

        return take

    def take_last(self) -> None:
        """Take the contacts of a step that a frame may end with."""
        self._lengths.append(self._write(self.copy() or _NONE))

    def _ender(self) -> Callable[[bytes | None], None]:
        write, tell, lengths, ends = self._write, self._block.tell, self._lengths, self._ends

        def end_frame(contacts: bytes | None = None) -> None:
            if contacts is not None:
                lengths.append(write(contacts or _NONE))
            ends.append(len(lengths))
            if tell() > BATCH:
                self._work_out()

        return end_frame

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

    def _work_out(self) -> None:
        """Turn what waits into points; steps after the last frame wait on."""
        if not self._ends:
            return
        ends = np.array(self._ends)
        self._frame += len(ends)
        lengths = np.array(self._lengths[: ends[-1]], np.int64)
        del self._lengths[: ends[-1]], self._ends[:]
        with self._block.getbuffer() as block:
            used = int(lengths.sum())
            if self._memory.fields and used > len(lengths) * HEAD.size:
                every = _Contacts(block[:used], lengths, self._memory, self._pyramidal)
                self._make_points(every, ends)
                every.release()
            rest = bytes(block[used : self._block.tell()])
        self._block.seek(0)
        self._write(rest)

    def _make_points(self, every: _Contacts, ends: Any) -> None:
        """Make points of the contacts of steps.

        Args:
            every: contacts of S steps.
            ends: (F,) where the steps of each frame end; the last one is the frame's own.
        """
        step, normal, geom = every.step, every.normal(), every.geoms()
        code = self._geom_body[geom[0]] * self._bodies + self._geom_body[geom[1]]
        touch = normal > 0
        weak = np.flatnonzero(~touch)
        touch[weak] = every.active[weak] & (every.floats("dist", weak) <= 0)
        pair = self._number_pairs(code)
        self.unrecorded += int((touch & (pair < 0)).sum())
        rows = np.flatnonzero(touch & (pair >= 0))
        if not len(rows):
            return
        kept = keep_contacts(step[rows], pair[rows], normal[rows], ends)
        some = rows[kept.rows]
        points = np.zeros(len(some), CONTACT_POINT)
        points["position"] = every.floats("pos", some, 3)
        axes = every.floats("frame", some, 9)
        points["normal"] = axes[:, :3]
        points["force"] = every.forces(some, normal[some], axes) * kept.own[:, None]
        points["peak_force"] = kept.peak
        points["depth"] = -every.floats("dist", some)
        points["geom1"], points["geom2"] = self._geom_index[geom[:, some]]
        self._done.append((points, kept.frame + (self._frame - len(ends))))

    def _number_pairs(self, code: Any) -> Any:
        """Number the pairs of bodies that touch.

        Args:
            code: (C,) first body × ``_bodies`` + second body.

        Returns:
            (C,) number of the pair, from 0 on, in whatever order its bodies stand, and −1 where the
            trace does not have a body's shape.
        """
        many = self._bodies
        there = np.flatnonzero(np.bincount(code, minlength=many * many))
        if not np.array_equal(there, self._there):
            bodies = np.sort(np.stack(np.divmod(there, many)), axis=0)
            number = np.unique(bodies[0] * many + bodies[1], return_inverse=True)[1]
            self._there = there
            self._number = np.full(many * many, -1)
            self._number[there] = np.where(bodies[1] < many - 1, number.ravel(), -1)
        return self._number[code]


class _Contacts:
    """The contacts of many steps and their constraint forces, where they lie among each other.

    Attributes:
        step: (C,) number of the step that each contact belongs to, ascending.
        active: (C,) whether it has constraint forces.
    """

    def __init__(
        self, block: memoryview, lengths: Any, memory: StepMemory, pyramidal: bool
    ) -> None:
        """Find the contacts.

        Args:
            block: what ``StepMemory.copy`` gave of one step after the other.
            lengths: (S,) bytes of each step.
            memory: what it was copied from.
            pyramidal: whether friction cones are pyramids.
        """
        self._floats = np.frombuffer(block, np.float64)
        self._ints = np.frombuffer(block, np.int32)
        self._fields, self._pyramidal = memory.fields, pyramidal
        starts = np.cumsum(lengths) - lengths
        sizes = self._ints[starts >> 2].astype(np.int64)
        starts += HEAD.size
        self.step = np.repeat(np.arange(len(lengths)), sizes)
        within = np.arange(len(self.step)) - (np.cumsum(sizes) - sizes)[self.step]
        self._at = []
        for window in memory.windows:
            self._at.append(starts[self.step] + within * window)
            starts += sizes * window
        address = self._int("efc_address")
        self.active = address >= 0
        self._row = (starts >> 3)[self.step] + address
        self._dim = self._int("dim")

    def release(self) -> None:
        """Let go of the memory that the contacts lie in."""
        del self._floats, self._ints

    def _int(self, name: str, k: int = 0) -> Any:
        """(C,) the k-th number of a field."""
        window, offset, _ = self._fields[name]
        return self._ints[(self._at[window] + (offset + 4 * k)) >> 2]

    def geoms(self) -> Any:
        """(2, C) MuJoCo's ids of the shapes."""
        return np.stack([self._int("geom"), self._int("geom", 1)])

    def floats(self, name: str, some: Any, width: int = 1) -> Any:
        """(K,), or (K, width), numbers of contacts ``some`` (K,)."""
        window, offset, _ = self._fields[name]
        first = (self._at[window][some] + offset) >> 3
        return self._floats[first if width == 1 else first[:, None] + np.arange(width)]

    def normal(self) -> Any:
        """(C,) N, normal force; of a pyramid the sum of its edges; 0 where there is no force."""
        edges = np.maximum(2 * (self._dim - 1), 1) if self._pyramidal else np.ones_like(self._dim)
        many = int(edges.max(initial=1))
        total = self._edge(0, self.active, slice(None))
        same = int(edges.min(initial=many)) == many
        for k in range(1, many):
            there = self.active if same else self.active & (edges > k)
            total += self._edge(k, there, slice(None))
        return total

    def _edge(self, k: int, there: Any, some: Any) -> Any:
        """The k-th constraint force of contacts, 0 where there is none."""
        return np.where(there, self._floats.take(self._row[some] + k, mode="clip"), 0.0)

    def forces(self, some: Any, normal: Any, axes: Any) -> Any:
        """(K, 3) N, the whole force on the second geom in the world (as ``mju_decodePyramid``).

        Args:
            some: (K,) contacts.
            normal: (K,) N.
            axes: (K, 9) the frame of each contact, the normal first.
        """
        axes = axes.reshape(-1, 3, 3)
        there = self.active[some] & (self._dim[some] >= 3)
        friction = self.floats("friction", some, 2)
        force = normal[:, None] * axes[:, 0]
        for k in (0, 1):
            if self._pyramidal:
                difference = self._edge(2 * k, there, some) - self._edge(2 * k + 1, there, some)
                along = friction[:, k] * difference
            else:
                along = self._edge(k + 1, there, some)
            force += along[:, None] * axes[:, k + 1]
        return force
