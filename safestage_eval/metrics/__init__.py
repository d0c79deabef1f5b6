"""Rates over judged episodes, with their counts."""

from .aggregate import Aggregate, aggregate
from .by_rule import RuleCount, by_rule
from .outcome import Outcome, outcomes
from .outcome_rows import outcomes_of, read_outcomes
from .rates import METRICS, Rates, by_policy_stage, metrics, rates
from .seeds import Group, Rate

__all__ = [
    "METRICS",
    "Aggregate",
    "Group",
    "Outcome",
    "Rate",
    "Rates",
    "RuleCount",
    "aggregate",
    "by_policy_stage",
    "by_rule",
    "metrics",
    "outcomes",
    "outcomes_of",
    "rates",
    "read_outcomes",
]
