"""How much memory a process holds."""

from __future__ import annotations

import os
import re
from pathlib import Path

from safestage_eval.errors import InputError

PROCESSES = Path("/proc")
"""Where Linux tells of processes."""

_UNITS = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}


def resident(pid: int) -> int:
    """Bytes of a process in memory; 0 for one that has ended. Linux only."""
    try:
        pages = (PROCESSES / f"{pid}/statm").read_text("ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def limit(text: str) -> int:
    """Bytes that a process may hold. Raises InputError also where no process tells what it holds."""
    if not resident(os.getpid()):
        raise InputError(
            f"--memory {text}", "cannot be kept: this system does not tell what a process holds.",
            "any value on Linux", "leave it out",
        )  # fmt: skip
    return size(text)


def size(text: str) -> int:
    """Bytes from ``600 MB``, ``2GiB`` or a plain number; kilo is 1,024. Raises InputError."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)(?:i?b)?\s*", text, re.IGNORECASE)
    if not found:
        raise InputError(text, "is no amount of memory.", "such as 800 MB or 2 GB")
    return int(float(found[1]) * _UNITS[found[2].lower()])
