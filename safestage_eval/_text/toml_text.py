"""Untrusted TOML."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from safestage_eval.size_limits import current
from safestage_eval.units import finite

MOST_PARTS = 100
"""Names one below the other in a key (``a.b.c``); the time that a parser takes grows with their square."""

_LONG_KEY = re.compile(
    r"""(?<![\w-])(?>(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    f"{{{MOST_PARTS}}}"
)


_NO_VALUE = re.compile(
    r"""'{3}.*?'{3}|"{3}(?:\\.|[^\\])*?"{3}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*""", re.DOTALL
)
"""Texts, names in quotes, and comments."""

_VALUE = re.compile(r"[=,\[]\s*([-+.\w]+)")


class NumberError(tomllib.TOMLDecodeError):
    """A number in a TOML text that is not finite.

    Attributes:
        what: what it is.
        line, column: where it stands, from 1 on.
    """

    what = "a number that is not finite, or has too many digits"

    def __init__(self, text: str) -> None:
        """Find it in the text."""
        bare = _NO_VALUE.sub(lambda found: re.sub(r"[^\n]", "_", found[0]), text)
        at = next((v.start(1) for v in _VALUE.finditer(bare) if not _is_readable(v[1])), 0)
        self.line, self.column = text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)
        super().__init__(f"{self.what} (at line {self.line}, column {self.column})")


def _is_readable(word: str) -> bool:
    try:
        return _is_finite(tomllib.loads(f"word = {word}"))
    except tomllib.TOMLDecodeError:  # no value
        return True
    except ValueError:  # an integer of more digits than Python reads
        return False


def _is_finite(value: Any) -> bool:
    """Whether all numbers of a value are."""
    if isinstance(value, dict):
        return all(map(_is_finite, value.values()))
    if isinstance(value, list):
        return all(map(_is_finite, value))
    try:
        return not isinstance(value, int | float) or isinstance(finite(value), float)
    except ValueError:
        return False


def from_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text.

    Raises:
        NumberError: it has a number that is not finite.
        tomllib.TOMLDecodeError: that, or it is no TOML.
        RecursionError: lists, tables or names lie within one another without end.
    """
    if len(text) > (most := current().document):
        what = f"{len(text):,} characters; {most:,} at most, or --limits document={len(text)}"
        raise tomllib.TOMLDecodeError(what)
    if _LONG_KEY.search(text):
        raise RecursionError(f"a key of more than {MOST_PARTS} names")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # an integer of more digits than Python reads
        raise NumberError(text) from None
    if not _is_finite(table):
        raise NumberError(text)
    return table
