"""Outcome of one hostile input."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

FINE = ("same", "unknown", "problem", "lie")
"""Allowed outcomes of an input: judged as if it were whole, judged less surely where evidence is gone,
refused in words, or read as what somebody else might have recorded or written (``oracle``)."""

BAD = ("unforeseen", "changed", "false pass", "swollen")
"""Forbidden outcomes: an unforeseen error, another verdict, among these a safer one, and more
memory than the bound."""


class Outcome(NamedTuple):
    """One of ``FINE`` or ``BAD``, what was done to the input, and what was said."""

    kind: str
    what: str
    said: str = ""

    @property
    def bad(self) -> bool:
        """It may not be so."""
        return self.kind in BAD


def unchanged(truth: Mapping[str, str], found: Mapping[str, str], what: str) -> Outcome:
    """Verdicts by rule where all evidence is there as it was: every one is the same."""
    if found == truth:
        return Outcome("same", what)
    return Outcome(_worst(truth, found), what, f"nothing is gone, but {_told(truth, found)}")


def compared(truth: Mapping[str, str], found: Mapping[str, str], what: str) -> Outcome:
    """Verdicts of what was damaged: each is the one of the whole, or inconclusive."""
    other = {rule: found.get(rule, "gone") for rule in truth if found.get(rule) != truth[rule]}
    if found.keys() - truth.keys() or set(other.values()) - {"inconclusive"}:
        return Outcome(_worst(truth, found), what, _told(truth, found))
    return Outcome("unknown" if other else "same", what, ", ".join(sorted(other)))


def weakened(truth: Mapping[str, str], found: Mapping[str, str], what: str) -> Outcome:
    """Verdicts of what had evidence taken away: none is safer, and none is surely another one."""
    for rule, was in truth.items():
        if safer(was, found.get(rule, "gone")):
            return Outcome("false pass", what, _told(truth, found))
        if (was, found.get(rule)) == ("pass", "violation"):
            return Outcome("changed", what, _told(truth, found))
    return Outcome("same" if found == truth else "unknown", what, _told(truth, found))


def safer(was: str, now: str) -> bool:
    """Whether the second verdict is safer than the first."""
    if was == "violation":
        return now in ("pass", "not_applicable", "gone")
    return was == "inconclusive" and now == "pass"


def _worst(truth: Mapping[str, str], found: Mapping[str, str]) -> str:
    return (
        "false pass"
        if any(safer(was, found.get(rule, "gone")) for rule, was in truth.items())
        else "changed"
    )


def _told(truth: Mapping[str, str], found: Mapping[str, str]) -> str:
    rules = [rule for rule in {**truth, **found} if truth.get(rule) != found.get(rule)]
    return ", ".join(f"{r} {truth.get(r, 'none')} -> {found.get(r, 'gone')}" for r in rules)
