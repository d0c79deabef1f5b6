"""The measurement that decides a verdict, for what is shown and said of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from safestage_eval.rules import syntax as ast


class Witness(NamedTuple):
    """The decisive atom at its decisive frame.

    Attributes:
        signal: the atom with the bodies' names, ``clearance(dumbbell, glasses)``.
        bodies: those names.
        frame: where its value was taken.
        value, limit: SI; None for a relation, which has no size.
        margin: SI, distance of the value from the limit, negative when violated.
        dimension: of value, limit and margin.
        name: of the signal alone, ``clearance``; None for a relation.
        tied: another atom has the very same margin there, so that naming this one is arbitrary.
        at_least: the value is only known to be no less (a clearance beyond what had to be known).
        state: the state that decided, where it has a sentence of its own.
        bearers: what bears the body, where the signal measures against that; in its sentence.
        needs: on which side of the limit the value must lie, as ``>=``; of a relation ``true`` or
            ``false``. Empty where neither is asked.
    """

    signal: str
    bodies: tuple[str, ...]
    frame: int
    value: float | None = None
    limit: float | None = None
    margin: float | None = None
    dimension: str | None = None
    name: str | None = None
    at_least: bool = False
    tied: bool = False
    state: ast.Call | None = None
    needs: str = ""
    bearers: tuple[str, ...] = ()

    @property
    def said(self) -> str:
        """The signal as a sentence names it: ``edge_margin(cup) on shelf``."""
        return f"{self.signal} on {' and '.join(self.bearers)}" if self.bearers else self.signal

    def or_tied(self, margins: Sequence[float], decisive: float) -> Witness:
        """The witness, marked where several margins are the decisive one."""
        alike = sum(margin == decisive for margin in margins)
        return self._replace(tied=True) if alike > 1 else self
