"""Numbers of things in words, and the first few of many."""

from collections.abc import Sequence


def count(number: int, noun: str) -> str:
    """``1 episode``, ``2 episodes``, ``2 bodies``."""
    if number == 1:
        return f"1 {noun}"
    return f"{number} {noun[:-1]}ies" if noun.endswith(("dy", "cy")) else f"{number} {noun}s"


def first_few(names: Sequence[str], most: int) -> str:
    """List the first ``most`` names, and count the rest: ``cup, bowl and 4 more``."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
