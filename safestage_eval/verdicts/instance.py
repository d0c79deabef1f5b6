"""One combination of bodies in one scope, and the margin that a rule has there."""

from __future__ import annotations

from typing import NamedTuple

from safestage_eval.rules import syntax as ast
from safestage_eval.states.scope import Scope

from .values import Env


class Instance(NamedTuple):
    """The outcome of one combination of bodies in one scope.

    Attributes:
        env: role → body.
        scope: the frames that were judged.
        lower, upper: bounds of the margin; negative upper is a violation.
        clause: the decisive obligation; None where something needed is unknown.
        frame: where it is decided.
        resolved: for a rule with ``until``: the frame at which that came, None if never.
        number: of the scope among those of these bodies.
    """

    env: Env
    scope: Scope
    lower: float
    upper: float
    clause: ast.Clause | None
    frame: int
    resolved: int | None = None
    number: int = 0

    @property
    def violated(self) -> bool:
        """Certainly violated."""
        return self.upper < 0

    @property
    def undecided(self) -> bool:
        """Neither certainly violated nor certainly not."""
        return self.lower < 0 <= self.upper
