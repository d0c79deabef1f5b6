"""Conditions of a rule file as states that can be asked for, frame by frame."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import RuleSet, load_rules
from safestage_eval.verdicts.ask import ask


def with_states(name: str, states: str) -> RuleSet:
    """A benchmark's rule set and further states, in the rule language."""
    head = f'[ruleset]\nformat = 1\nname = "asked"\nversion = "1.0.0"\nextends = ["{name}"]\n'
    with TemporaryDirectory() as folder:
        path = Path(folder) / "asked.toml"
        path.write_text(head + states, "utf-8")
        return load_rules([path])


class Asked:
    """Signals and states of an episode, by expressions under a rule set."""

    def __init__(self, episode: Episode, rules: RuleSet) -> None:
        self.episode, self.rules = episode, rules
        self.relations = Relations(Signals(episode))

    def __call__(self, expression: str) -> NDArray[np.float64]:
        """(T,) signal in SI; of states and relations 1 or 0; NaN where it is not known."""
        series = ask(self.episode, expression, self.relations, self.rules)
        shape = len(self.episode)
        lower: NDArray[Any] = np.broadcast_to(series.lower, shape)
        upper: NDArray[Any] = np.broadcast_to(series.upper, shape)
        with np.errstate(invalid="ignore"):
            close = (lower == upper) | (upper - lower <= 1e-6)
        return np.where(close, upper, np.nan).astype(np.float64)
