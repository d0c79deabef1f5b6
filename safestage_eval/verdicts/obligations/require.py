"""``require``: a condition that must hold in every frame that is judged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Band, Bool
from safestage_eval.verdicts.look_ahead import Foresight, Look

from .obligation import Margin, Obligation


class Require(Obligation):
    """Its margin is the least of all frames."""

    kind = "require"
    kept = "Held from {begin} to {end}: {what}."

    def margin_of(self, band: Band, sure: Bool | None, lasting: Window) -> Margin:  # noqa: ARG002
        """The least margin of any frame: every one must hold."""
        if not len(band.lower):
            return Margin(np.inf, np.inf, 0)
        upper = band.upper if sure is None else np.where(sure, band.upper, np.inf)
        least, lowest = int(upper.argmin()), int(band.lower.argmin())
        frame = least if upper[least] < 0 else lowest
        return Margin(float(band.lower[lowest]), float(upper[least]), frame)

    def broken(self, band: Band, sure: Bool, lasting: Window) -> Bool:  # noqa: ARG002
        """The frames in which the condition certainly fails."""
        return band.false & sure

    def breaches(self, rule: ast.Rule) -> Sequence[ast.Alternative]:
        """The whole condition, if it may require that some state does not hold."""
        condition = rule.require
        atoms = () if condition is None else condition.atoms
        absence = any(
            isinstance(a, ast.AnyOf) or (isinstance(a, ast.StateAtom) and not a.want) for a in atoms
        )
        return (condition,) if condition is not None and absence else ()

    def foresight(self, look: Look, rule: ast.Rule, what: ast.Alternative) -> Foresight:  # noqa: ARG002
        """A frame that breaks it is certain as soon as its condition is known there."""
        return look.alternative(what)
