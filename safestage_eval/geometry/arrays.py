"""Arrays as the kernels of this room take them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def owned(array: ArrayLike) -> NDArray[np.float64]:
    """Make a writable C-ordered float64 copy: the one array type that kernels are compiled for."""
    return np.array(array, np.float64, order="C")


def as_numbers(array: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return the array if it is writable, C-ordered, float32 or float64; otherwise an owned copy.

    For kernels that only read, of tracks as they are stored; each type is compiled for itself.
    """
    numbers = np.asarray(array)
    usual = numbers.dtype in (np.float32, np.float64) and numbers.flags.carray
    return numbers if usual else owned(numbers)
