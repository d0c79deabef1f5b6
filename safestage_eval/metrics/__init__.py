"""Rates over judged episodes, with their counts."""

from .outcome import Outcome, outcomes
from .rates import Rates, by_policy_stage, metrics, rates

__all__ = ["Outcome", "Rates", "by_policy_stage", "metrics", "outcomes", "rates"]
