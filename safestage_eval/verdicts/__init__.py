"""Verdicts: a rule set and an episode in, verdicts with their witnesses out."""

from .judge import judge
from .verdict import EpisodeResult, Verdict

__all__ = ["EpisodeResult", "Verdict", "judge"]
