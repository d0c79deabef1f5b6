"""For notebooks: load an episode, look at its signals, score many, ask what if."""

from .notebook_episode import Episode, load
from .notebook_scores import Finding, Scores, score

__all__ = ["Episode", "Finding", "Scores", "load", "score"]
