"""Untrusted JSON."""

from __future__ import annotations

import json
import re
from typing import Any

from safestage_eval.size_limits import current
from safestage_eval.units import finite

_PERHAPS_TOO_LARGE = re.compile(r"[0-9]{300}|[eE]\+?[0-9]{3}")


def from_json(text: str | bytes, *, foreign: bool = False) -> Any:
    """Parse a JSON text.

    ``foreign``: of a file of which others are the authors, and we read little: Python writes NaN there.

    Raises:
        json.JSONDecodeError: it is no JSON, lists lie within one another without end, it has a number that
            is not finite, or it is longer than the limits allow.
        UnicodeDecodeError: bytes that are no text. Both are a ValueError.
    """
    if len(text) > (most := current().document):
        what = f"{len(text):,} characters; {most:,} at most, or --limits document={len(text)}"
        raise json.JSONDecodeError(what, "", 0)
    if isinstance(text, bytes):
        text = text.decode(json.detect_encoding(text), "surrogatepass")

    def parse(digits: str) -> float | int:
        try:
            value = finite(digits)
        except ValueError as error:
            raise json.JSONDecodeError(str(error), text, text.find(digits)) from None
        return int(digits) if digits.lstrip("-").isdecimal() else value

    hooks: dict[str, Any] = {} if foreign else {"parse_constant": parse}
    if _PERHAPS_TOO_LARGE.search(text):
        hooks |= {"parse_int": parse} if foreign else {"parse_int": parse, "parse_float": parse}
    try:
        return json.loads(text, **hooks)
    except RecursionError:
        raise json.JSONDecodeError("nested too deep", "", 0) from None


def get_inside(table: Any, *keys: str) -> Any:
    """Return the value below nested tables; None where one of them is missing or no table."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table
