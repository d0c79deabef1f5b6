"""Memory that stays with the process between episodes, where the C library would hand it back."""

from __future__ import annotations

import ctypes
import sys

_TRIM, _MAP = -1, -3
"""M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's malloc.h."""
KEPT, LARGE = 64 << 20, 16 << 20
"""Bytes of free memory that are kept; bytes from which on an array is mapped by itself."""


def keep() -> None:
    """Keep freed memory for the next episode; does nothing where there is no glibc.

    An episode's arrays are of the size that glibc gives back to the system at once, and getting
    them anew, page by page, takes a tenth of the time of scoring. For a process that scores and
    does little else: it holds what it frees for the whole process.
    """
    if sys.platform != "linux":
        return
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # another C library
        return
    mallopt(_TRIM, KEPT)
    mallopt(_MAP, LARGE)
