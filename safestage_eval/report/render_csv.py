"""Rows as comma-separated values."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from safestage_eval._text.csv_cell import to_cell
from safestage_eval._text.json_out import to_json


def render_csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """A line of heads, then one line per row."""
    return "".join(csv_pieces(columns, rows))


def csv_pieces(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The lines one by one; keys that are no column are left out, missing ones empty.

    Truth values are ``true`` and ``false``, lists JSON, None is empty.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row.get(name)) for name in columns])
        yield buffer.getvalue()
        buffer.seek(0)
        buffer.truncate()
    yield buffer.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return to_cell(value)
    if isinstance(value, bool):
        return str(value).lower()
    return to_json(value) if isinstance(value, list | dict) else value
