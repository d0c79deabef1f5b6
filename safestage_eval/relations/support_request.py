"""A request for one signal that needs relations or the support graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import Options, Signal
from safestage_eval.evidence.series import Series, exact, unknown

if TYPE_CHECKING:
    from safestage_eval.episode import Episode
    from safestage_eval.evidence.reference import Reference

    from .measure import Relations


class SupportRequest(NamedTuple):
    """One signal with ``support`` to be measured.

    Attributes:
        relations: of the episode; ``relations.signals`` are the facts of other signals.
        signal: its declaration.
        bodies: names of bodies or unions, in the signal's order.
        since: what a change is measured from; None for the baseline.
        options: what the signal's definition adds.
        at: (N,) the frames at which a ``costly`` signal is measured; all frames of any other.
    """

    relations: Relations
    signal: Signal
    bodies: tuple[str, ...]
    since: Reference | None
    options: Options
    at: NDArray[np.int64]

    @property
    def episode(self) -> Episode:
        """The episode."""
        return self.relations.episode

    def number(self, name: str) -> float:
        """The value of an option that is a number, or its default, in SI."""
        value = dict(self.options).get(name)
        if not isinstance(value, float | int):
            value = next(option.default for option in self.signal.options if option.name == name)
        assert value is not None  # the option has a default
        return float(value)

    def exact(self, values: NDArray[np.float64]) -> Series:
        """A series that is known at every frame."""
        return exact(values, self.signal.dimension)

    def unknown(self, why: str) -> Series:
        """A series that is unknown at every frame, and why."""
        return unknown(len(self.at), self.signal.dimension, why)
