"""What became of one hostile input."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

FINE = ("same", "unknown", "problem", "read")
"""What may become of an input: judged as if it were whole, judged inconclusive somewhere, refused
in words, or read where there is no verdict to compare with."""

BAD = ("unforeseen", "changed", "false pass")
"""What may not: an error that nobody foresaw, another verdict, and among these another ``pass``."""


class Outcome(NamedTuple):
    """One of ``FINE`` or ``BAD``, what was done to the input, and what was said."""

    kind: str
    what: str
    said: str = ""

    @property
    def bad(self) -> bool:
        """It may not be so."""
        return self.kind in BAD


def compared(truth: Mapping[str, str], found: Mapping[str, str], what: str) -> Outcome:
    """Verdicts by rule of what was damaged, held against those of what was whole."""
    other = {rule for rule in truth if found.get(rule) != truth[rule]}
    if found.keys() - truth.keys():
        return Outcome("changed", what, f"rules {sorted(found.keys() - truth.keys())}")
    passes = sorted(rule for rule in other if found.get(rule) == "pass")
    if passes:
        return Outcome("false pass", what, ", ".join(passes))
    wrong = sorted(rule for rule in other if found.get(rule) != "inconclusive")
    if wrong:
        return Outcome("changed", what, ", ".join(f"{rule}: {found.get(rule)}" for rule in wrong))
    return Outcome("unknown" if other else "same", what, ", ".join(sorted(other)))
