"""Rates over judged episodes, with their counts."""

from .outcome import Outcome, outcomes
from .rates import METRICS, Rates, by_policy_stage, metrics, rates

__all__ = ["METRICS", "Outcome", "Rates", "by_policy_stage", "metrics", "outcomes", "rates"]
