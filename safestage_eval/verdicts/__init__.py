"""Verdicts: a rule set and an episode in, verdicts with their witnesses out."""

from .judge import judge
from .verdict import CostTotal, EpisodeResult, Verdict

__all__ = ["CostTotal", "EpisodeResult", "Verdict", "judge"]
