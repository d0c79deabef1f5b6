"""JSON that somebody else wrote."""

from __future__ import annotations

import json
from typing import Any


def from_json(text: str | bytes) -> Any:
    """What a text says.

    Raises:
        json.JSONDecodeError: it is no JSON, or lists lie within one another without end.
        UnicodeDecodeError: bytes that are no text. Both are a ValueError.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise json.JSONDecodeError("nested too deep", "", 0) from None
