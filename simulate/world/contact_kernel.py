"""Contacts of a physics step gathered by body pairs, as machine code: it runs at every step of a rollout."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel
from safestage_eval.formats import CONTACT_POINT

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Gathered(NamedTuple):
    """Room for what a frame's steps leave.

    Attributes:
        points: (R,) contact points of the frame's own step.
        numbers: (R, 12) the same memory: position, normal, force, peak force, depth; the last one is ``ids``'.
        ids: (R, 24) the same memory; the last two are the geoms.
        pair: (R,) the pair of bodies that each point belongs to.
        pairs: (R,) pairs that touch in this step.
        total: (R,) N, normal force of each of these.
        seen: (R, 12) the first point of each pair since the last frame.
        seen_pair: (R,) its pair.
        peak: (R,) N, the greatest normal force of it.
        known: (1,) how many pairs were seen since the last frame.
    """

    points: NDArray[Any]
    numbers: NDArray[np.float32]
    ids: NDArray[np.uint16]
    pair: I64
    pairs: I64
    total: F64
    seen: NDArray[np.float32]
    seen_pair: I64
    peak: F64
    known: I64

    @classmethod
    def of(cls, room: int) -> Gathered:
        """Room for as many points of a step, and as many pairs of bodies."""
        points = np.zeros(room, CONTACT_POINT)
        return cls(
            points,
            points.view(np.float32).reshape(room, 12),
            points.view(np.uint16).reshape(room, 24),
            pair=np.zeros(room, np.int64),
            pairs=np.zeros(room, np.int64),
            total=np.zeros(room),
            seen=np.zeros((room, 12), np.float32),
            seen_pair=np.zeros(room, np.int64),
            peak=np.zeros(room),
            known=np.zeros(1, np.int64),
        )

    def wider(self, room: int) -> Gathered:
        """More room, with what was seen since the last frame."""
        result, old = Gathered.of(room), len(self.peak)
        result.seen[:old], result.seen_pair[:old] = self.seen, self.seen_pair
        result.peak[:old], result.known[:] = self.peak, self.known
        return result


@kernel
def gather(
    address: NDArray[np.int32],
    dim: NDArray[np.int32],
    geom: NDArray[np.int32],
    dist: F64,
    pos: F64,
    frame: F64,
    friction: F64,
    forces: F64,
    pyramids: bool,
    body: I64,
    index: I64,
    numbers: NDArray[np.float32],
    ids: NDArray[np.uint16],
    pair: I64,
    pairs: I64,
    total: F64,
    seen: NDArray[np.float32],
    seen_pair: I64,
    peak: F64,
    known: I64,
    last: bool,
) -> int:
    """Take the contacts of a step (C); returns how many points the frame has, 0 unless it is the ``last`` step.

    A contact counts if it pushes or overlaps. With an elliptic cone the rows of the force are normal and
    friction; with a pyramid each is an edge of it, two per direction (as ``mju_decodePyramid``).
    """
    points = found = 0
    end = len(forces) - 1
    for c in range(len(address)):
        row = address[c]
        if row < 0:
            continue
        normal = along1 = along2 = 0.0
        if not pyramids:
            if dim[c] >= 1:
                normal = forces[min(row, end)]
            if dim[c] >= 3:
                along1, along2 = forces[min(row + 1, end)], forces[min(row + 2, end)]
        elif dim[c] == 1:
            normal = forces[row]
        else:
            for k in range(5):
                least = 3 if k < 2 else 4 if k == 2 else 6
                if dim[c] >= least:
                    a, b = forces[min(row + 2 * k, end)], forces[min(row + 2 * k + 1, end)]
                    normal += a + b
                    if k == 0:
                        along1 = friction[c, 0] * (a - b)
                    elif k == 1:
                        along2 = friction[c, 1] * (a - b)
        if not (normal > 0 or dist[c] <= 0):
            continue
        one, other = body[geom[c, 0]], body[geom[c, 1]]
        key = min(one, other) << 20 | max(one, other)
        for axis in range(3):
            numbers[points, axis] = pos[c, axis]
            numbers[points, 3 + axis] = frame[c, axis]
            force = normal * frame[c, axis]
            force = force + along1 * frame[c, 3 + axis]
            force = force + along2 * frame[c, 6 + axis]
            numbers[points, 6 + axis] = force
        numbers[points, 9] = 0.0
        numbers[points, 10] = -dist[c]
        ids[points, 22], ids[points, 23] = index[geom[c, 0]], index[geom[c, 1]]
        pair[points] = key
        at = 0
        while at < found and pairs[at] != key:
            at += 1
        if at == found:
            pairs[at], total[at] = key, 0.0
            found += 1
            if not last:
                held = 0
                while held < known[0] and seen_pair[held] != key:
                    held += 1
                if held == known[0]:
                    seen_pair[held], peak[held] = key, -1.0
                    for k in range(12):
                        seen[held, k] = numbers[points, k]
                    known[0] += 1
        total[at] += normal
        points += 1
    if not last:
        for at in range(found):
            for held in range(known[0]):
                if seen_pair[held] == pairs[at] and total[at] > peak[held]:
                    peak[held] = total[at]
        return 0
    for c in range(points):
        at = 0
        while pairs[at] != pair[c]:
            at += 1
        most = total[at]
        before = 0.0
        for held in range(known[0]):
            if seen_pair[held] == pair[c]:
                before = peak[held]
        numbers[c, 9] = max(most, before)
    for held in range(known[0]):
        at = 0
        while at < found and pairs[at] != seen_pair[held]:
            at += 1
        if at == found:
            for k in range(12):
                numbers[points, k] = seen[held, k]
            for k in range(6, 9):
                numbers[points, k] = 0.0
            numbers[points, 9] = peak[held]
            points += 1
    known[0] = 0
    return points
