"""A document of plain values as JSON."""

from __future__ import annotations

import math
from typing import Any

from safestage_eval._text.json_out import to_json


def render_json(document: Any) -> str:
    """The text, indented by one; infinite and NaN numbers, which JSON lacks, are null."""
    return to_json(_finite(document), 1) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
