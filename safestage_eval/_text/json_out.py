"""JSON that may be shown on a terminal: characters that nobody sees are escaped, and mean the same."""

from __future__ import annotations

import json
from typing import Any


def to_json(value: Any, indent: int | None = None) -> str:
    """The text of plain values. Raises ValueError for infinite numbers and NaN, which JSON lacks."""
    return visible_json(json.dumps(value, indent=indent, ensure_ascii=False, allow_nan=False))


def visible_json(text: str) -> str:
    """JSON text with control characters, changes of writing direction and halves of characters escaped."""
    if text.isascii() and "\x7f" not in text:
        return text
    return "".join(c if c.isprintable() or c in "\n " else _escape(c) for c in text)


def _escape(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[i : i + 4]}" for i in range(0, len(units), 4))
