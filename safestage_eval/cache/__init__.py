"""Signals once, verdicts many: what was measured of an episode, kept in a folder between runs.

The folder may be deleted at any time, shared by any number of processes, and cut off or damaged:
what is missing there is measured again. See docs/performance.md for what is trusted.
"""

from .folder import CacheFolder
from .memory import Memory
from .question import question

__all__ = ["CacheFolder", "Memory", "question"]
