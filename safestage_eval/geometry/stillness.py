"""When bodies are where they were before: frames that may share what was measured at one of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .mover import Mover

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

STILL = 5e-5
"""m. Outlines of bodies no point of which has moved by as much are not computed anew."""

BLOCK = 128
"""Frames that are compared with each other. Counted from the last one: the end is what is asked for most."""

FARTHEST = 100.0
"""m. Of planes, points further from their origin than this are not looked at."""

TINY = np.finfo(np.float64).tiny


def first_alike(movers: Sequence[Mover], frames: I64, apart: float = STILL) -> I64:
    """(N,) for each of the frames (N,) one at which all bodies are where they are then.

    No point of any is further than ``apart`` (m) from there. It is the last frame of the last block
    that ends as the frame's own block does, or else the first frame of that block that has none
    before it itself, whichever frames are asked for. Where nothing can move, all frames have the first one.
    """
    moving = [mover for mover in movers if len(mover) > 1]
    if not moving or not len(frames):
        return np.full(len(frames), frames[0] if len(frames) else 0, np.int64)
    total = min(len(mover) for mover in moving)
    ends = np.arange(total - 1, -1, -BLOCK)
    home = ends[_first_near(_near(moving, ends[:, None], ends, apart))]
    blocks = (total - 1 - frames) // BLOCK
    first = home[blocks]
    away = np.flatnonzero(~_near(moving, frames, first, apart))
    for block in np.unique(blocks[away]):
        asked = away[blocks[away] == block]
        rows = np.arange(max(ends[block] - BLOCK + 1, 0), int(frames[asked].max()) + 1)
        alike = _first_near(_near(moving, rows[:, None], rows, apart))
        first[asked] = rows[alike[frames[asked] - rows[0]]]
    return first


def _first_near(near: Bool) -> I64:
    """(N,) of each row the first near it (N, N) that has none before it itself."""
    first = np.full(len(near), -1)
    for row, others in enumerate(near):
        if first[row] < 0:
            first[row] = row
            first[others & (first < 0)] = row
    return first


def _near(movers: Sequence[Mover], some: I64, others: I64, apart: float) -> Bool:
    """Whether no point of any body moves by more than ``apart`` (m) between ``some`` frames and ``others``."""
    near = np.ones(np.broadcast_shapes(some.shape, others.shape), np.bool_)
    for mover in movers:
        far = min(float(np.linalg.norm(mover.shape.centre) + mover.shape.radius), FARTHEST)
        position, turn = mover.position.astype(np.float64), mover.orientation.astype(np.float64)
        turn /= np.maximum(np.sqrt((turn**2).sum(1, keepdims=True)), TINY)
        way = np.sqrt(((position[some] - position[others]) ** 2).sum(-1))
        cosine = np.minimum(np.abs((turn[some] * turn[others]).sum(-1)), 1.0)  # of half the angle
        near &= way + 2 * far * np.sqrt(1 - cosine**2) <= apart
    return near
