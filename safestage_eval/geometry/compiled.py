"""How the numerical kernels of this room are compiled, and where the machine code is kept.

Numba's own cache looks only at the file of the function it compiles: a kernel that calls an edited
helper in another file would keep the old helper. So the cache folder is named after the content of
all files of this room, and stale machine code can never answer.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

F = TypeVar("F", bound=Callable[..., Any])


@cache
def cache_folder() -> Path:
    """Beside the sources where that is writable, else under the user's cache folder."""
    room = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(room.glob("*.py")):
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:12]}"
    if os.access(room, os.W_OK):
        return room / "__pycache__" / name
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "safestage" / name


def kernel(function: F) -> F:
    """Compile on first call, with IEEE arithmetic (no fast-math), without the GIL, and keep it.

    References to arrays are not counted: whoever calls it holds them until it returns. Counting
    them, at every row of an array that is looked at, took four fifths of a distance. So it cannot
    allocate (that is an error when it is compiled); what must is ``allocating``.
    """
    return _compiled(function, inline=False)


def helper(function: F) -> F:
    """As kernel, for a small function: its code goes into its callers.

    A call hands over every array of a Packed or Motion, which takes longer than such a function.
    """
    return _compiled(function, inline=True)


def allocating(function: F) -> F:
    """As kernel, for a function that makes arrays of its own."""
    return _compiled(function, inline=False, counted=True)


def _compiled(function: F, *, inline: bool, counted: bool = False) -> F:
    chosen = numba.config.CACHE_DIR
    if not chosen:
        numba.config.CACHE_DIR = str(cache_folder())
    try:
        compile_it = numba.njit(
            cache=True, nogil=True, error_model="numpy", forceinline=inline, _nrt=counted
        )
        return cast(F, compile_it(function))
    finally:
        numba.config.CACHE_DIR = chosen


def owned(array: ArrayLike) -> NDArray[np.float64]:
    """A writable C-ordered float64 copy: the one array type that kernels are compiled for."""
    return np.array(array, np.float64, order="C")


def as_numbers(array: ArrayLike) -> NDArray[np.floating[Any]]:
    """Writable, C-ordered, of float32 or float64: the array itself if it is so, or an owned copy.

    For kernels that only read, of tracks as they are stored; each type is compiled for itself.
    """
    found = np.asarray(array)
    usual = found.dtype in (np.float32, np.float64) and found.flags.carray
    return found if usual else owned(found)
