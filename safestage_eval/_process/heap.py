"""Memory that stays with the process between episodes, where the C library would hand it back."""

from __future__ import annotations

import ctypes
import gc
import os
import sys

from .memory_limit import resident

_TRIM, _MAP = -1, -3
"""M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's malloc.h."""
KEPT, LARGE = 64 << 20, 16 << 20
"""Bytes of free memory that are kept; bytes from which on an array is mapped by itself."""
AIM = 230 << 20
"""Bytes that a process should hold at most, free ones included; more where an episode takes more."""
EVERY = 16
"""Episodes between two times that free memory is handed back: the next one asks for it again, page by page."""


def keep() -> None:
    """Keep freed memory for the next episode; does nothing where there is no glibc.

    An episode's arrays are of the size that glibc gives back to the system at once, and getting
    them anew, page by page, takes a tenth of the time of scoring. For a process that scores and
    does little else: it holds what it frees for the whole process.
    """
    mallopt = _function("mallopt")
    if mallopt is not None:
        mallopt(_TRIM, KEPT)
        mallopt(_MAP, LARGE)


class Bound:
    """Hands free memory back where a process has come to hold much.

    Episodes end in reference cycles, of few objects and many megabytes, which Python collects seldom;
    Arrow keeps what it frees; and what is free lies between what is used, so that it grows beyond what
    ``KEPT`` says. Together that was 1.5 MB an episode.
    """

    def __init__(self, aim: int = AIM) -> None:
        """``aim``: bytes."""
        self._aim, self._since = aim, EVERY
        self._trim = _function("malloc_trim")

    def hold(self) -> bool:
        """After an episode: collect cycles where much is held; whether free memory was handed back, too."""
        self._since += 1
        if self._trim is None or resident(os.getpid()) <= self._aim:
            return False
        gc.collect()
        if self._since <= EVERY:
            return False
        self._since = 0
        if "pyarrow" in sys.modules:
            sys.modules["pyarrow"].default_memory_pool().release_unused()
        self._trim(0)
        return True


def _function(name: str) -> ctypes._NamedFuncPointer | None:
    """A function of glibc; None where there is another C library."""
    if sys.platform != "linux":
        return None
    try:
        function: ctypes._NamedFuncPointer = getattr(ctypes.CDLL(None), name)
    except (OSError, AttributeError):
        return None
    return function
