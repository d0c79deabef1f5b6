"""Untrusted JSON."""

from __future__ import annotations

import json
from typing import Any

from safestage_eval.size_limits import current


def from_json(text: str | bytes) -> Any:
    """Parse a JSON text.

    Raises:
        json.JSONDecodeError: it is no JSON, lists lie within one another without end, or it is longer
            than the limits allow.
        UnicodeDecodeError: bytes that are no text. Both are a ValueError.
    """
    if len(text) > (most := current().document):
        what = f"{len(text):,} characters; {most:,} at most, or --limits document={len(text)}"
        raise json.JSONDecodeError(what, "", 0)
    try:
        return json.loads(text)
    except RecursionError:
        raise json.JSONDecodeError("nested too deep", "", 0) from None


def get_inside(table: Any, *keys: str) -> Any:
    """Return the value below nested tables; None where one of them is missing or no table."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table
