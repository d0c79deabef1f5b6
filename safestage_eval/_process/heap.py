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
STEP = 12 << 20
"""Bytes by which it has to grow before free memory is looked for once more."""


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

    Cycles are collected after each episode. Free memory is handed back only where more of it has
    gathered than an episode was seen to take: the next one would ask for it again, page by page.
    """

    def __init__(self, aim: int = AIM) -> None:
        """``aim``: bytes."""
        self._aim = self._beyond = aim
        self._trim = _function("malloc_trim")
        self._left: int | None = None
        """Bytes held when memory was last handed back; None once the next episode was measured by it."""
        self._taken = 0
        """Bytes that an episode takes at the most, as measured so."""

    def hold(self) -> bool:
        """After an episode: whether free memory was looked for and handed back."""
        held = resident(os.getpid())
        if self._trim is None or held <= self._aim:
            return False
        gc.collect()
        if self._left is not None:
            self._taken = max(self._taken, held - self._left)
            self._beyond, self._left = max(self._aim, self._left + self._taken + STEP), None
        if held <= self._beyond:
            return False
        if "pyarrow" in sys.modules:
            sys.modules["pyarrow"].default_memory_pool().release_unused()
        self._trim(0)
        self._left = resident(os.getpid())
        self._beyond = max(self._aim, self._left + self._taken + STEP)
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
