"""Pieces of a page that the browser inflates only when they are asked for."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

TYPE = "application/x-deflate"
"""Type of the ``<script>`` elements that hold such a piece; no browser runs them."""


def packed(data: str | bytes, level: int = 9) -> str:
    """Compress to zlib in base64, as ``DecompressionStream("deflate")`` reads it."""
    raw = data.encode() if isinstance(data, str) else data
    return base64.b64encode(zlib.compress(raw, level)).decode()


def block(name: str, data: str) -> str:
    """Write an element that carries a packed piece under a name (letters, digits and dashes)."""
    return f'<script type="{TYPE}" id="piece-{name}">{data}</script>\n'


def script(name: str, data: str) -> str:
    """Write a script that hands a packed piece over to the page that asked for it."""
    return f'safestagePiece("{name}","{data}");\n'


def columns(table: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """A table column by column; where values repeat, as a list of values and places in it."""
    out: dict[str, Any] = {}
    for name, values in table.items():
        index: dict[str, int] = {}
        keys = [json.dumps(value) for value in values]
        for key in keys:
            index.setdefault(key, len(index))
        if 2 * len(index) > len(values):
            out[name] = list(values)
        else:
            out[name] = {
                "values": [json.loads(key) for key in index],
                "at": [index[key] for key in keys],
            }
    return out


def compact(value: Any) -> str:
    """JSON without blanks. Raises ValueError for numbers that JSON does not have."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
