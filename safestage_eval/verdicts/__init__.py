"""Verdicts: a rule set and an episode in, verdicts with their witnesses out."""
