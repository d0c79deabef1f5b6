"""A thing that a trace says twice, and differently."""

from __future__ import annotations

from dataclasses import dataclass

from safestage_eval.errors import TraceError


@dataclass
class ContradictionError(TraceError):
    """A contradiction within a trace, and its subject.

    Attributes:
        kind: which comparison failed: ``velocity``, ``surface``, ``bears``, …
        bodies: names of the bodies or joints that were compared; empty for the header alone.
        time: s, when; None where it holds throughout.
    """

    kind: str = ""
    bodies: tuple[str, ...] = ()
    time: float | None = None


def contradiction(
    kind: str,
    bodies: tuple[str, ...],
    where: str,
    what: str,
    allowed: str = "",
    fix: str = "",
    time: float | None = None,
) -> ContradictionError:
    """A contradiction of a kind; the other arguments as in ``InputError``."""
    return ContradictionError(
        where, what, allowed, fix, kind, bodies, None if time is None else float(time)
    )
