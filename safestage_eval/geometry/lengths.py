"""Lengths of many vectors, and how far many points are from where they were."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]


def lengths(vectors: ArrayLike, axes: int | None = None) -> F64:
    """(T,) Euclidean norm of the first ``axes`` components of (T, k) vectors; of all if None."""
    some = np.asarray(vectors, np.float64)[:, :axes]
    return np.asarray(np.sqrt(np.einsum("ti,ti->t", some, some)))


def distances(points: ArrayLike, others: ArrayLike, axes: int | None = None) -> F64:
    """(T,) distance of points (T, k) from others, (T, k) or (1, k), over the first ``axes``."""
    return lengths(np.asarray(points, np.float64) - np.asarray(others, np.float64), axes)
