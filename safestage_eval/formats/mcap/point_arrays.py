"""The functions of ``contact_kernels`` by NumPy, where the compiler of kernels has not been loaded.

What they take and return is told there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def count_pairs(geoms: NDArray[np.uint32], seen: NDArray[np.int64]) -> bool:
    """As the kernel of this name."""
    first, second = geoms & 0xFFFF, geoms >> 16
    if max(int(first.max()), int(second.max())) >= len(seen):
        return False
    key = first.astype(np.int64) * len(seen) + second
    seen += np.bincount(key, minlength=seen.size).reshape(seen.shape)
    return True


def sort_points(
    geoms: NDArray[np.uint32], counts: NDArray[np.int64], rank: Any, pair: NDArray[np.int64],
    following: NDArray[np.int64], rows: Any, frames: Any,
) -> bool:  # fmt: skip
    """As the kernel of this name."""
    code = rank[geoms & 0xFFFF, geoms >> 16]
    frame = np.repeat(np.arange(len(counts)), counts)
    if ((code[1:] < code[:-1]) & (frame[1:] == frame[:-1])).any():
        return False
    own = pair[code]
    rows[:] = np.argsort(own, kind="stable")
    frames[:] = frame[rows]
    following += np.bincount(own, minlength=len(following))
    return True


def take_points(words: NDArray[np.uint32], rows: NDArray[np.int32], out: Any) -> None:
    """As the kernel of this name."""
    out[:] = words[rows]


def take_column(rows: NDArray[Any], first: int, out: NDArray[Any]) -> None:
    """As the kernel of this name."""
    out[:] = rows[:, first : first + out.shape[1]]
