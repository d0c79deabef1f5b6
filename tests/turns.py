"""What is tried in turn: a quarter of many like cases, another one with each commit in CI.

The environment variable ``SAFESTAGE_TURN`` says which quarter, 0 unless it is set; ``all`` is all.
"""

import os
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")

QUARTERS = 4
TURN = os.environ.get("SAFESTAGE_TURN", "0")


def in_turn(cases: Sequence[T]) -> list[T]:
    """Every fourth case, beginning with the one whose turn it is."""
    return list(cases if TURN == "all" else cases[int(TURN) % QUARTERS :: QUARTERS])
