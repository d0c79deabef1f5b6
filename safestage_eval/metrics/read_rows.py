"""Tables in files, row by row: JSON, JSON lines, CSV and Parquet, found from their content."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError

ALLOWED = "JSON, JSON lines, CSV or Parquet"

_TRUTHS = ("assigned", "success", "violation", "undersampled")
_NUMBERS = (
    "margin", "margin_normalised", "value", "limit", "time", "worst_time", "success_time",
    "exposure_time",
)  # fmt: skip
_LISTS = ("bodies", "intervals", "raw_intervals", "sources", "notes")
_SAID = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}


def read_rows(
    path: str | Path, columns: Collection[str] | None = None, allowed: str = ALLOWED
) -> list[dict[str, Any]]:
    """The rows of a table; of a JSON object with ``episodes``, those.

    Args:
        path: the file.
        columns: what is needed; other columns of a Parquet file are not read.
        allowed: what messages say would have been accepted.

    Raises InputError for a file that cannot be read, or whose cells cannot be what they must be.
    """
    file = Path(path)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}.", allowed) from None
    if data.startswith(b"PAR1"):
        return _checked(str(path), _parquet(file, columns, allowed))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(str(path), "not a table.", allowed) from None
    if not text.strip():
        raise InputError(str(path), "it is empty.", allowed)
    rows = _text(str(path), text, allowed)
    if "\\ud" in text.lower():
        _whole_characters(str(path), rows)
    return _checked(str(path), rows)


def _checked(where: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows. Raises InputError for lists where none belong, and numbers that are none."""
    for name in dict.fromkeys(name for row in rows for name in row):
        kinds = {type(row.get(name)) for row in rows}
        if name in _NUMBERS:
            wrong = kinds - {int, float, type(None)}
        else:
            wrong = kinds & ({dict} if name in _LISTS else {dict, list})
        if int in kinds and any(
            type(row.get(name)) is int and abs(row[name]) >= 2**63 for row in rows
        ):
            wrong |= {int}
        for number, row in enumerate(rows if wrong else (), 1):
            value = row.get(name)
            if type(value) in wrong and not (type(value) is int and abs(value) < 2**63):
                is_ = "a number" if name in _NUMBERS else "text or a number"
                raise InputError(f"{where}, row {number}", f"{name} is {str(value)[:60]}.", is_)
    return rows


def _whole_characters(where: str, rows: list[dict[str, Any]]) -> None:
    """Raises InputError for half of a pair of UTF-16 in JSON, which no file can hold as text."""
    for number, row in enumerate(rows, 1):
        try:
            json.dumps(row, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise InputError(f"{where}, row {number}", "it has half of a character.") from None


def truth(value: Any, where: str, name: str) -> bool | None:
    """A cell that says yes or no; None where it is empty. Raises InputError for anything else."""
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, float) and math.isnan(value):
        return None
    text = str(value).strip().lower()
    if text in ("", "null", "none", "nan"):
        return None
    if text not in _SAID:
        raise InputError(where, f"{name} is {value!r}.", "true, false, 1, 0, or nothing if unknown")
    return _SAID[text]


def _parquet(path: Path, columns: Collection[str] | None, allowed: str) -> list[dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path)
        wanted = None
        if columns is not None:
            wanted = [name for name in file.schema_arrow.names if name in columns]
        rows: list[dict[str, Any]] = file.read(columns=wanted).to_pylist()
    except (pa.ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(str(path), f"a broken Parquet file: {error}.", allowed) from None
    return rows


def _text(where: str, text: str, allowed: str) -> list[dict[str, Any]]:
    if not text.lstrip().startswith(("{", "[")):
        return _csv(where, text)
    try:
        whole = json.loads(text)
    except json.JSONDecodeError:
        return _lines(where, text, allowed)
    rows = whole.get("episodes", [whole]) if isinstance(whole, dict) else whole
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(where, "JSON, but no results.", allowed)
    return rows


def _lines(where: str, text: str, allowed: str) -> list[dict[str, Any]]:
    rows = []
    for number, line in enumerate(text.split("\n"), 1):
        if line.strip():
            try:
                row = json.loads(line)
            except json.JSONDecodeError as error:
                raise InputError(f"{where}, line {number}", f"{error.msg}.", allowed) from None
            if not isinstance(row, dict):
                raise InputError(f"{where}, line {number}", "not a result row.", allowed)
            rows.append(row)
    return rows


def _csv(where: str, text: str) -> list[dict[str, Any]]:
    try:
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except csv.Error as error:
        raise InputError(where, f"not readable as CSV: {error}.") from None
    found = []
    for number, row in enumerate(rows, 1):
        place = f"{where}, row {number}"
        if row.get(None):
            raise InputError(place, "it has more cells than there are columns.")
        found.append({name: _cell(place, name, value) for name, value in row.items()})
    return found


def _cell(where: str, name: str, value: str | None) -> Any:
    if not value:
        return None
    if name in _TRUTHS:
        return truth(value, where, name)
    if name in _NUMBERS:
        try:
            return float(value)
        except ValueError:
            raise InputError(where, f"{name} is no number: {value!r}.") from None
    return value
