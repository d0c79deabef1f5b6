"""Untrusted TOML."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from safestage_eval.size_limits import current

MOST_PARTS = 100
"""Names one below the other in a key (``a.b.c``); the time that a parser takes grows with their square."""

_LONG_KEY = re.compile(
    r"""(?<![\w-])(?>(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    f"{{{MOST_PARTS}}}"
)


def from_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text.

    Raises:
        tomllib.TOMLDecodeError: it is no TOML.
        ValueError: it holds a number of too many digits.
        RecursionError: lists, tables or names lie within one another without end.
    """
    if len(text) > (most := current().document):
        what = f"{len(text):,} characters; {most:,} at most, or --limits document={len(text)}"
        raise tomllib.TOMLDecodeError(what)
    if _LONG_KEY.search(text):
        raise RecursionError(f"a key of more than {MOST_PARTS} names")
    return tomllib.loads(text)
