"""Outcomes of faults, and the laws that hold after each."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from child import Child
from victims import Victim


@dataclass
class Row:
    """Outcome of one kind of fault to one writer."""

    victim: str
    fault: str
    tried: int = 0
    hit: int = 0
    """How often it was at work when the fault came."""
    kept: int = 0
    """Episodes that were written for good before, over all tries; every one of them is there."""
    lost: int = 0
    halves: int = 0
    next_failed: int = 0
    said: set[str] = field(default_factory=set)


def left_of(row: Row, victim: Victim, folder: Path, committed: set[str]) -> set[str]:
    """Ids of the episodes that are there; half files, and what was committed and is gone, are counted."""
    try:
        left = victim.left(folder)
    except AssertionError as error:
        row.halves += 1
        row.said.add(f"HALF: {error}")
        left = set()
    row.kept += len(committed)
    row.lost += len(committed - left)
    return left


def after(row: Row, victim: Victim, folder: Path, committed: set[str]) -> None:
    """Assert what holds after any fault, and that the next run finishes the work."""
    left_of(row, victim, folder, committed)
    again = Child(victim, folder)
    code = again.wait()
    again.committed()
    try:
        whole = code == 0 and victim.left(folder) == victim.everything
    except AssertionError:
        whole = False
    if not whole:
        row.next_failed += 1
        row.said.add(f"NEXT RUN: exit code {code}: {again.said()}")
