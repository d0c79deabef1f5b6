"""When nothing moved: frames that may share what was measured at the first of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel

from .mover import Mover
from .pose import unit

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

STILL_DISTANCE, STILL_ANGLE = 1e-5, 1e-4
"""m and rad. Outlines of bodies that moved less are not computed anew."""

ANCHORED = 512
"""Frames after which a run of stillness begins anew, whatever came before."""


def still_since(
    movers: Sequence[Mover],
    frames: I64,
    distance: float = STILL_DISTANCE,
    angle: float = STILL_ANGLE,
) -> I64:
    """(N,) for each of the frames (N,) the one at which its run of stillness began.

    Within a run no body is further than ``distance`` (m) and ``angle`` (rad) from where it was when
    the run began. Where runs begin does not depend on which frames are asked for: they are
    those of whole blocks of the trace, of which only the ones that hold a frame that is asked for
    are looked at. Where nothing can move, all frames have the first one's run.

    Raises ValueError where an orientation is no rotation (norm 0 or not finite).
    """
    moving = [mover for mover in movers if len(mover) > 1]
    if not moving:
        return np.full(len(frames), frames[0] if len(frames) else 0, np.int64)
    since = np.empty(len(frames), np.int64)
    total = min(len(mover) for mover in moving)
    block = frames // ANCHORED
    for one in np.unique(block):
        wanted = block == one
        first, end = int(one) * ANCHORED, min(total, int(frames[wanted].max()) + 1)
        position = np.stack([m.position[first:end] for m in moving]).astype(np.float64)
        orientation = np.stack([unit(m.orientation[first:end]) for m in moving])
        start = np.empty(end - first, np.int64)
        _runs(position, orientation, distance**2, math.sin(angle / 4), start)
        since[wanted] = first + start[frames[wanted] - first]
    return since


def still_runs(movers: Sequence[Mover], frames: I64) -> Iterator[tuple[int, I64]]:
    """Cut frames (N,) into runs of stillness: the frame each run began at, and its frames."""
    since = still_since(movers, frames)
    for start in np.unique(since):
        yield int(start), frames[since == start]


@kernel
def _runs(position: F64, orientation: F64, square: float, chord: float, start: I64) -> None:
    """Positions (M, T, 3) and unit quaternions (M, T, 4); the run of each frame goes to ``start``.

    A turn by θ between unit quaternions is min‖q∓q′‖ = 2 sin(θ/4); ``chord`` is half of that.
    """
    begun = 0
    for t in range(start.shape[0]):
        for m in range(position.shape[0]):
            way, minus, plus = 0.0, 0.0, 0.0
            for i in range(3):
                step = position[m, t, i] - position[m, begun, i]
                way += step * step
            for i in range(4):
                p, q = orientation[m, t, i], orientation[m, begun, i]
                minus += (p - q) * (p - q)
                plus += (p + q) * (p + q)
            if way > square or math.sqrt(min(minus, plus)) / 2.0 > chord:
                begun = t
                break
        start[t] = begun
