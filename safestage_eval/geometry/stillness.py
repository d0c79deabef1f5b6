"""When bodies are where they were before: frames that may share what was measured at one of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .mover import Mover
from .pose import unit

I64 = NDArray[np.int64]

STILL = 5e-5
"""m. Outlines of bodies no point of which has moved by as much are not computed anew."""

BLOCK = 128
"""Frames that are compared with each other. Counted from the last one: the end is what is asked for most."""

FARTHEST = 100.0
"""m. Of planes, points further from their origin than this are not looked at."""


def first_alike(movers: Sequence[Mover], frames: I64, apart: float = STILL) -> I64:
    """(N,) for each of the frames (N,) one at which all bodies are where they are then.

    No point of any is further than ``apart`` (m) from there. It is the first such frame of the
    frame's block that has none before it itself, whichever frames are asked for. Where nothing can
    move, all frames have the first one.

    Raises ValueError where an orientation is no rotation (norm 0 or not finite).
    """
    moving = [mover for mover in movers if len(mover) > 1]
    first = np.full(len(frames), frames[0] if len(frames) else 0, np.int64)
    if not moving:
        return first
    total = min(len(mover) for mover in moving)
    blocks = (total - 1 - frames) // BLOCK
    for block in np.unique(blocks):
        asked = blocks == block
        start, end = max(total - (int(block) + 1) * BLOCK, 0), int(frames[asked].max()) + 1
        near = np.ones((end - start, end - start), np.bool_)
        for mover in moving:
            near &= _moved(mover, start, end) <= apart
        alike = np.full(len(near), -1)
        for frame, row in enumerate(near):
            if alike[frame] < 0:
                alike[row & (alike < 0)] = frame
        first[asked] = start + alike[frames[asked] - start]
    return first


def _moved(mover: Mover, start: int, end: int) -> NDArray[np.float64]:
    """(N, N) m, how far at most a point of a body is at one frame from where it is at another."""
    far = min(float(np.linalg.norm(mover.shape.centre) + mover.shape.radius), FARTHEST)
    position = mover.position[start:end].astype(np.float64)
    position -= position.mean(0)
    square = (position**2).sum(1)
    way = square[:, None] + square - 2 * position @ position.T
    turn = unit(mover.orientation[start:end])
    cosine = np.minimum(np.abs(turn @ turn.T), 1.0)  # of half the angle
    return np.asarray(np.sqrt(np.maximum(way, 0)) + 2 * far * np.sqrt(1 - cosine**2))
