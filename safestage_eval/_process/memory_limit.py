"""How much memory a process holds."""

from __future__ import annotations

import os
from pathlib import Path

from safestage_eval.errors import InputError
from safestage_eval.size_limits import size

PROCESSES = Path("/proc")
"""Where Linux tells of processes."""


def resident(pid: int) -> int:
    """Bytes of a process in memory; 0 for one that has ended. Linux only."""
    try:
        pages = (PROCESSES / f"{pid}/statm").read_text("ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def allocated() -> int:
    """Bytes that this process has asked for, in memory or not; 0 where the system does not tell. Linux only."""
    try:
        pages = (PROCESSES / f"{os.getpid()}/statm").read_text("ascii").split()[5]
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
