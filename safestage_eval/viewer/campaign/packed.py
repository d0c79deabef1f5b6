"""Pieces of the page that the browser inflates only when they are opened."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

TYPE = "application/x-deflate"
"""Type of the ``<script>`` elements that hold such a piece; no browser runs them."""


def packed(text: str) -> str:
    """Compress text to zlib in base64, as ``DecompressionStream("deflate")`` reads it."""
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def block(name: str, data: str) -> str:
    """Write an element that carries a piece under a name (letters, digits and dashes)."""
    return f'<script type="{TYPE}" id="{name}">{data}</script>\n'


def columns(table: Mapping[str, Sequence[Any]], repeated: Sequence[str]) -> str:
    """Write a table as JSON, column by column; ``repeated`` ones as a list of values and indices to it."""
    out: dict[str, Any] = {}
    for name, values in table.items():
        if name in repeated:
            index = {value: i for i, value in enumerate(dict.fromkeys(values))}
            out[name] = {"values": list(index), "at": [index[value] for value in values]}
        else:
            out[name] = list(values)
    return json.dumps(out, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
