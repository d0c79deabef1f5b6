"""Lengths of many vectors, and how far many points are from where they were."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval._process.compiled import kernel

from .arrays import as_numbers

F64 = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]]


def lengths(vectors: ArrayLike, axes: int | None = None) -> F64:
    """(T,) Euclidean norm of the first ``axes`` components of (T, k) vectors; of all if None."""
    some = as_numbers(vectors)
    return distances(some, np.zeros((1, some.shape[1])), axes)


def distances(points: ArrayLike, others: ArrayLike, axes: int | None = None) -> F64:
    """(T,) distance of points (T, k) from others, (T, k) or (1, k), over the first ``axes``."""
    a, b = as_numbers(points), as_numbers(others)
    out = np.empty(len(a))
    _distances(a, b, a.shape[1] if axes is None else axes, out)
    return out


@kernel
def _distances(points: Numbers, others: Numbers, axes: int, out: F64) -> None:
    last = others.shape[0] - 1
    for t in range(out.shape[0]):
        s, square = min(t, last), 0.0
        for i in range(axes):
            way = np.float64(points[t, i]) - np.float64(others[s, i])
            square += way * way
        out[t] = math.sqrt(square)
