"""Result files as ``safestage score`` writes them: JSON, JSON lines, CSV, Parquet."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError

from .results import NEEDED

ALLOWED = "a file that safestage score wrote with --format json, jsonl, csv or parquet"

_NUMBERS = ("margin", "value", "limit", "time", "worst_time")


def read_results(path: str | Path) -> list[dict[str, Any]]:
    """The rows of a result file; its format is found from its content.

    Raises InputError for a file that cannot be read or lacks a column that is needed.
    """
    file = Path(path)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}.", ALLOWED) from None
    if data.startswith(b"PAR1"):
        rows = _parquet(file)
    else:
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            raise InputError(str(path), "not a result file.", ALLOWED) from None
        rows = _text(str(path), text)
    for number, row in enumerate(rows, 1):
        missing = [name for name in NEEDED if name not in row]
        if missing:
            raise InputError(f"{path}, row {number}", f"lacks {', '.join(missing)}.", ALLOWED)
    return rows


def _parquet(path: Path) -> list[dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        rows: list[dict[str, Any]] = pq.read_table(path).to_pylist()
    except pa.ArrowException as error:
        raise InputError(str(path), f"a broken Parquet file: {error}.", ALLOWED) from None
    return rows


def _text(where: str, text: str) -> list[dict[str, Any]]:
    if not text.lstrip().startswith(("{", "[")):
        return _csv(where, text)
    try:
        whole = json.loads(text)
    except json.JSONDecodeError:
        return _lines(where, text)
    rows = whole.get("episodes", [whole]) if isinstance(whole, dict) else whole
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(where, "JSON, but no results.", ALLOWED)
    return rows


def _lines(where: str, text: str) -> list[dict[str, Any]]:
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip():
            try:
                row = json.loads(line)
            except json.JSONDecodeError as error:
                raise InputError(f"{where}, line {number}", f"{error.msg}.", ALLOWED) from None
            if not isinstance(row, dict):
                raise InputError(f"{where}, line {number}", "not a result row.", ALLOWED)
            rows.append(row)
    return rows


def _csv(where: str, text: str) -> list[dict[str, Any]]:
    reader = csv.DictReader(text.splitlines())
    missing = [name for name in NEEDED if name not in (reader.fieldnames or ())]
    if missing:
        raise InputError(f"{where}, line 1", f"lacks the columns {', '.join(missing)}.", ALLOWED)
    return [
        {name: _cell(where, number, name, value) for name, value in row.items() if name}
        for number, row in enumerate(reader, 2)
    ]


def _cell(where: str, number: int, name: str, value: str | None) -> Any:
    if not value:
        return None
    if name in ("assigned", "success", "violation"):
        return value.lower() == "true"
    if name in _NUMBERS:
        try:
            return float(value)
        except ValueError:
            raise InputError(
                f"{where}, line {number}", f"{name} is no number: {value!r}."
            ) from None
    return value
