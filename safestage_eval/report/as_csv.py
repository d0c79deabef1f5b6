"""Results as comma-separated rows; lists are written as JSON."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from safestage_eval.scoring import Scores

from .rows import COLUMNS, rows


def render(scores: Scores) -> str:
    """A header line, then one line per episode and rule."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows(scores):
        writer.writerow({name: _cell(value) for name, value in row.items()})
    return buffer.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list) else value
