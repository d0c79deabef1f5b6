"""Signals once, verdicts many: what was measured of an episode, kept in a folder between runs.

The folder may be deleted at any time, shared by any number of processes, and cut off or damaged:
what is missing there is measured again. See docs/performance.md for what is trusted.
"""

from typing import TYPE_CHECKING, Any

from .folder import CacheFolder
from .question import question

if TYPE_CHECKING:
    from .memory import Memory

__all__ = ["CacheFolder", "Memory", "question"]


def __getattr__(name: str) -> Any:
    """What measures comes with everything that is measured, and is loaded when it is asked for."""
    if name == "Memory":
        from .memory import Memory

        return Memory
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
