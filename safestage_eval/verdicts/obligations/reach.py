"""``reach``: something that must hold in some frame, for as long as ``for`` says."""

from __future__ import annotations

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.persistence import held_from
from safestage_eval.verdicts.look_ahead import Foresight, Look, awaiting

from .obligation import Margin, Obligation, nearest_run


class Reach(Obligation):
    """Its margin is the greatest of all frames."""

    kind = "reach"
    kept = "Reached between {begin} and {end}: {what}."

    def margin_of(self, band: Band, sure: Bool | None, lasting: Window) -> Margin:
        """How near the condition comes to holding for long enough."""
        if not len(band.lower):
            return Margin(-np.inf, -np.inf, 0)
        surely, possibly, frame = nearest_run(band, lasting)
        if sure is None:
            return Margin(surely, possibly, frame)
        # a stretch that is not certain may be empty, or several, each of which would have to reach it
        return Margin(-np.inf, possibly if sure.any() else np.inf, frame)

    def cut(self, margin: Margin) -> Margin:
        """It may have been reached already, or be reached later."""
        return margin._replace(upper=np.inf)

    def broken(self, band: Band, sure: Bool, lasting: Window) -> Bool:  # noqa: ARG002
        """The whole scope, or nothing of it."""
        never = held_from(band.upper, lasting.loose).max(initial=-np.inf) < 0
        return np.full(len(band.lower), never)

    def foresight(self, look: Look, rule: ast.Rule, what: ast.Alternative) -> Foresight:  # noqa: ARG002
        """It is broken only when its span is over."""
        span = "the episode" if rule.during is None else "the span in which it must be reached"
        return awaiting(f"the end of {span}")
