"""Where episodes are judged: in worker processes of this machine, or on a Ray cluster.

Whatever the engine, it is the same pure function, ``scoring.score_episode``; an engine adds that
nothing which happens to a process costs more than the episode that was in it.
"""

from .engine import Engine, Found
from .settings import Settings

__all__ = ["Engine", "Found", "Settings"]
