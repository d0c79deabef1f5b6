"""Contact points sorted out by the pair of bodies that touch, and columns of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval._process.compiled import kernel


@kernel
def count_pairs(geoms: Any, seen: Any) -> bool:
    """How many points each pair of geoms has; false for a geom that there is no room for.

    Args:
        geoms: (C,) uint32, the first geom of a point in the lower half, the second in the upper.
        seen: (G, G) int64 to be filled.
    """
    for c in range(len(geoms)):
        first, second = np.uintp(geoms[c] & 0xFFFF), np.uintp(geoms[c] >> 16)
        if first >= np.uintp(len(seen)) or second >= np.uintp(len(seen)):
            return False
        seen[first, second] += 1
    return True


@kernel
def sort_points(
    geoms: Any, counts: Any, rank: Any, pair: Any, following: Any, rows: Any, frames: Any
) -> bool:
    """The rows of each pair of bodies, one pair after the other; false where a frame's rank falls.

    Args:
        geoms: as for ``count_pairs``.
        counts: (T,) how many points each frame has.
        rank: (G, G) place of each pair of geoms in the order of the contact table.
        pair: (R,) which pair of bodies each of these belongs to.
        following: (P,) where the rows of each pair begin, and afterwards where they end.
        rows: (C,) to be filled.
        frames: (C,) to be filled with the frame of each row.
    """
    c = 0
    for n in range(len(counts)):
        last = np.uintp(0)
        for _ in range(counts[n]):
            now = np.uintp(rank[np.uintp(geoms[c] & 0xFFFF), np.uintp(geoms[c] >> 16)])
            if now < last:
                return False
            last = now
            own = np.uintp(pair[now])
            to = np.uintp(following[own])
            rows[to], frames[to] = c, n
            following[own] += 1
            c += 1
    return True


@kernel
def take_points(words: Any, rows: Any, out: Any) -> None:
    """Some rows (N,) of (C, 12) words into (N, 12)."""
    for i in range(len(rows)):
        row = np.uintp(rows[i])
        for k in range(12):
            out[i, np.uintp(k)] = words[row, np.uintp(k)]


@kernel
def take_column(rows: Any, first: int, out: Any) -> None:
    """Neighbouring columns of rows (N, W) from the first one on into (N, columns)."""
    begin = np.uintp(first)
    for i in range(len(rows)):
        for k in range(out.shape[1]):
            out[i, np.uintp(k)] = rows[i, begin + np.uintp(k)]
