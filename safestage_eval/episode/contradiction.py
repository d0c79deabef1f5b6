"""A thing that a trace says twice, and differently."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from safestage_eval.errors import TraceError

Column = Literal[
    "position", "orientation", "linear_velocity", "angular_velocity", "contacts", "peak_force",
    "joint", "gripper", "mass", "inertia", "cavity", "tcp", "success",
]  # fmt: skip
"""Columns that may be doubtful: a body's, a joint's, or the contacts of one or two bodies."""

POSES: tuple[Column, ...] = ("position", "orientation")


@dataclass
class ContradictionError(TraceError):
    """A contradiction within a trace, and its subject.

    Attributes:
        code: of the check that found it: ``AUD115``.
        bodies: names of the bodies or joints that were compared; empty for the header alone.
        time: s, when; None where it holds throughout.
        field: of the header, that it is about.
        hides: columns of these bodies that cannot be believed then; empty: the whole recording cannot.
    """

    code: str = ""
    bodies: tuple[str, ...] = ()
    time: float | None = None
    hides: tuple[Column, ...] = ()
    field: str = ""


def doubt(
    what: str,
    allowed: str = "",
    fix: str = "",
    *,
    bodies: tuple[str, ...] = (),
    time: float | None = None,
    hides: tuple[Column, ...] = (),
    code: str = "",
    field: str = "",
) -> ContradictionError:
    """A contradiction; whoever runs the check that yields it adds where it is and the code."""
    return ContradictionError(
        "", what, allowed, fix, code, bodies, None if time is None else float(time), hides, field
    )
