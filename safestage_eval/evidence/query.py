"""One measurement of an episode as a value: what is measured, of which bodies, and how."""

from __future__ import annotations

import hashlib
from enum import Enum
from typing import Literal, NamedTuple

Kind = Literal["signal", "relation", "unmeasured", "between frames", "recorded", "force"]
"""Kinds of query: a signal; a relation; where something was not measured; how far a signal may
go between two frames; whether something was recorded at all; a sum of contact forces."""


class Growth(Enum):
    """How the answer to a query changes when an episode grows by frames at its end."""

    PER_FRAME = "the value at a frame depends on that frame alone"
    OPEN_END = "where velocities are derived from poses, the last frame is not known yet"
    WHOLE = "any value may change"


class Query(NamedTuple):
    """All that a measurement depends on besides the trace; equal queries have equal answers.

    Attributes:
        kind: of measurement.
        name: of the signal, relation or sum.
        bodies: names of bodies or unions, in the order of the arguments.
        since: key of the reference that a change is measured from; empty for the baseline.
        cap: m, for clearances: distances up to here are exact.
        deep: for clearances: depths of penetration are measured as well.
        slack: m, for clearances: how much wider the bounds may be.
        options: name → value (SI), sorted by name.
        frame: for ``between frames``: around which one.
        backend: that measures clearances.
        baseline: how many first frames estimate the initial state.
    """

    kind: Kind
    name: str = ""
    bodies: tuple[str, ...] = ()
    since: str = ""
    cap: float = 0.0
    deep: bool = False
    slack: float = 0.0
    options: tuple[tuple[str, float | str | tuple[float, ...]], ...] = ()
    frame: int = -1
    backend: str = "gjk"
    baseline: int = 5

    @property
    def digest(self) -> str:
        """32 hexadecimal digits."""
        return hashlib.sha256(repr(tuple(self)).encode()).hexdigest()[:32]
