"""Result files as ``safestage score`` writes them: JSON, JSON lines, CSV, Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.metrics.read_rows import read_rows

from .results import NEEDED

ALLOWED = "a file that safestage score wrote with --format json, jsonl, csv or parquet"


def read_results(path: str | Path) -> list[dict[str, Any]]:
    """The rows of a result file; its format is found from its content.

    Raises InputError for a file that cannot be read or lacks a column that is needed.
    """
    rows = read_rows(path, allowed=ALLOWED)
    for number, row in enumerate(rows, 1):
        missing = [name for name in NEEDED if name not in row]
        if missing:
            raise InputError(f"{path}, row {number}", f"lacks {', '.join(missing)}.", ALLOWED)
    return rows
