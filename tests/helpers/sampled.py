"""Shares of laws that hold of many cases: the same few of them in each run, all of them by ``make thorough``."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar
from zlib import crc32

ALL = bool(os.environ.get("SAFESTAGE_ALL_CASES"))
"""Whether every case is tried."""
FEW = bool(os.environ.get("SAFESTAGE_FEW_CASES"))
"""Whether one case must do, as with ``--quick``."""

Case = TypeVar("Case")


def tries(few: int, many: int) -> int:
    """How many cases of a law are tried: ``many`` by ``make thorough``, a few by ``make quick``."""
    return many if ALL else min(4, few) if FEW else few


def share(cases: Iterable[Case], one_in: int, *, of: str = "") -> list[Case]:
    """One in so many cases, evenly spread, and at least one.

    Args:
        cases: in an order that says something, such as that of their names.
        one_in: e.g. 4 for a quarter of them.
        of: a name from which it follows which ones: laws of different names take different cases.
    """
    found = list(cases)
    step = 1 if ALL else min(one_in, len(found))
    chosen = found[crc32(of.encode()) % step :: step]
    return chosen[:1] if FEW else chosen
