"""Tables in files, row by row: JSON, JSON lines, CSV and Parquet, found from their content."""

from __future__ import annotations

import csv
import json
import math
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from safestage_eval._text.csv_cell import from_cell
from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError
from safestage_eval.formats.discover import MCAP_MAGIC
from safestage_eval.formats.parquet import dataset_layout as layout

ALLOWED = "results of safestage score as JSON, JSON lines, CSV or Parquet"

BATCH = 4096
"""Rows of a Parquet file that are in memory at once."""

_TRUTHS = ("assigned", "success", "violation", "undersampled")
_NUMBERS = (
    "margin", "margin_normalised", "value", "limit", "time", "worst_time", "success_time",
    "exposure_time",
)  # fmt: skip
_LISTS = ("bodies", "breaches_by_level", "intervals", "raw_intervals", "sources", "notes")
_SAID = {
    **dict.fromkeys(("true", "1", "1.0"), True), **dict.fromkeys(("false", "0", "0.0"), False),
    **dict.fromkeys(("", "null", "none", "nan"), None),
}  # fmt: skip

Row = dict[str, Any]


def read_rows(
    path: str | Path, columns: Collection[str] | None = None, allowed: str = ALLOWED
) -> list[Row]:
    """Read all rows of a table, as ``each_row`` reads them."""
    return list(each_row(path, columns, allowed))


def each_row(
    path: str | Path, columns: Collection[str] | None = None, allowed: str = ALLOWED
) -> Iterator[Row]:
    """Yield the rows of a table, one after the other; of a JSON object with ``episodes``, those.

    A table is never in memory as a whole, unless it is one JSON document.

    Args:
        path: the file.
        columns: those needed; other columns of a Parquet file are not read.
        allowed: for messages: what is accepted.

    Raises InputError for a file that cannot be read, or whose cells cannot be what they must be.
    """
    where = Path(path)
    try:
        with where.open("rb") as file:
            beginning = file.read(4096)
        _refuse_other_files(where, beginning, allowed)
        first = beginning.removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
        reader = _json if first in (b"{", b"[") else _csv
        if beginning.startswith(b"PAR1"):
            reader = _parquet
        for number, row in enumerate(reader(where, columns, allowed), 1):
            yield _checked(f"{path}, row {number}", row)
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}.", allowed) from None
    except UnicodeDecodeError:
        raise InputError(str(path), "not a table.", allowed) from None


def _checked(where: str, row: Row) -> Row:
    """Return the row. Raises InputError for a list where none belongs, or a number or text that is none."""
    for name, value in row.items():
        kind = type(value)
        if kind is str and name not in _NUMBERS:
            if not value.isascii():
                _whole_characters(where, value)
            continue
        if kind is int:
            wrong = abs(value) >= 2**63
        elif name in _NUMBERS:
            wrong = value is not None and kind is not float
        else:
            wrong = kind is dict or (kind is list and name not in _LISTS)
        if wrong:
            allowed = "a number" if name in _NUMBERS else "text or a number"
            raise InputError(where, f"{name} is {str(value)[:60]}.", allowed)
        if kind is list:
            _whole_characters(where, json.dumps(value, ensure_ascii=False))
    return row


def _whole_characters(where: str, text: str) -> None:
    """Raises InputError for half of a pair of UTF-16 in JSON, which no file can hold as text."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InputError(where, "it has half of a character.") from None


def truth(value: Any, where: str, name: str) -> bool | None:
    """Read a cell that says yes or no; None where it is empty. Raises InputError for anything else."""
    if isinstance(value, bool) or value is None:
        return value
    text = str(value).strip().lower()
    if text not in _SAID:
        raise InputError(where, f"{name} is {value!r}.", "true, false, 1, 0, or nothing if unknown")
    return _SAID[text]


def demand_columns(
    row: Mapping[str, Any], columns: Iterable[str], where: str, allowed: str
) -> None:
    """Raise InputError where a row lacks a column; ``allowed``: what is accepted, for the message."""
    missing = [name for name in columns if name not in row]
    if missing:
        raise InputError(where, f"lacks {', '.join(missing)}.", allowed)


def is_missing(value: Any) -> bool:
    """Whether a cell says nothing."""
    return value is None or value == "" or (isinstance(value, float) and math.isnan(value))


def cell_text(value: Any) -> str:
    """Write a cell as text without spaces around it; empty where it says nothing."""
    return "" if is_missing(value) else str(value).strip()


def _parquet(path: Path, columns: Collection[str] | None, allowed: str) -> Iterator[Row]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(pa.OSFile(os.fsencode(path)))
        names = file.schema_arrow.names
        _refuse_other_columns(path, names, columns, allowed)
        wanted = [name for name in names if columns is None or name in columns]
        for batch in file.iter_batches(BATCH, columns=wanted):
            yield from batch.to_pylist()
    except (pa.ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(str(path), f"a broken Parquet file: {error}.", allowed) from None


def _json(path: Path, columns: Collection[str] | None, allowed: str) -> Iterator[Row]:
    """Rows line by line where the first line is one; otherwise those of one document."""
    with path.open(encoding="utf-8-sig", newline="\n") as file:
        lines = ((number, line) for number, line in enumerate(file, 1) if line.strip())
        begin, text = next(lines)
        try:
            whole, alone = from_json(text), True
        except json.JSONDecodeError:
            text += "".join(line for _, line in lines)
            whole, alone = _parsed(path, text, begin, allowed), False
        if alone and isinstance(whole, dict) and "episodes" not in whole:
            _refuse_other_columns(path, whole, columns, allowed)
            yield whole
            for number, line in lines:
                row = _parsed(path, line, number, allowed)
                if not isinstance(row, dict):
                    raise InputError(f"{path}, line {number}", "not a result row.", allowed)
                yield row
            return
    rows = whole.get("episodes", [whole]) if isinstance(whole, dict) else whole
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise _wrong_file(path, "JSON, but no results", allowed)
    if rows:
        _refuse_other_columns(path, rows[0], columns, allowed)
    yield from rows


def _parsed(path: Path, text: str, line: int, allowed: str) -> Any:
    """``line``: at which the text begins."""
    try:
        return from_json(text)
    except json.JSONDecodeError as error:
        place = f"{path}, line {line + error.lineno - 1}"
        raise InputError(place, f"not JSON: {error.msg}.", allowed) from None


def _csv(path: Path, columns: Collection[str] | None, allowed: str) -> Iterator[Row]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file)
            _refuse_other_columns(path, table.fieldnames or (), columns, allowed)
            for number, entry in enumerate(table, 1):
                place = f"{path}, row {number}"
                if None in entry:
                    raise InputError(place, "it has more cells than there are columns.")
                yield {name: _csv_cell(place, name, cell or "") for name, cell in entry.items()}
    except csv.Error as error:
        raise InputError(str(path), f"not readable as CSV: {error}.") from None


def _csv_cell(where: str, name: str, cell: str) -> Any:
    value = from_cell(cell)
    if name in _TRUTHS:
        return truth(value, where, name)
    if name in _NUMBERS and value:
        try:
            return float(value)
        except ValueError:
            raise InputError(where, f"{name} is no number: {value!r}.") from None
    return value or None


_BEGINNINGS = {
    MCAP_MAGIC: "a recording (MCAP)",
    b"PK\x03\x04": "a ZIP file, as of safestage-record",
    b"<": "a web page, or XML as of --format junit",
}
_TOML = re.compile(rb"(?:\s*(?:#[^\n]*)?\n)*(?:\s*\[\[?[\w.]+\]\]?\s*(?:#[^\n]*)?\n|format *= *1)")
_SCORE = "safestage score TRACES --format parquet --output rows.parquet writes results"


def _refuse_other_files(path: Path, beginning: bytes, allowed: str) -> None:
    """Raise InputError, which says what it is, for a file that is no table by its first bytes or its place."""
    text = beginning.removeprefix(b"\xef\xbb\xbf").lstrip()
    kind = next((kind for magic, kind in _BEGINNINGS.items() if text.startswith(magic)), "")
    if not text:
        kind = "an empty file"
    elif _TOML.match(beginning):
        kind = "a TOML file: rules or bindings"
    elif not kind and b"\0" in beginning and not beginning.startswith(b"PAR1"):
        kind = "not a table: it holds no text"
    elif path.parent.name in (*layout.TABLE_FOLDERS, "episodes") and any(
        layout.is_dataset(folder) for folder in path.absolute().parents[1:3]
    ):
        kind = "a table of recordings, not of results"
    if kind:
        raise _wrong_file(path, kind, allowed)


def _refuse_other_columns(
    path: Path, names: Collection[str], wanted: Collection[str] | None, allowed: str
) -> None:
    """Raise InputError for a table, or a text, whose columns are none of those that are wanted."""
    if wanted is not None and not set(names) & set(wanted):
        first = ", ".join(names)[:60]
        raise _wrong_file(path, f"text, or a table of something else: {first!r}", allowed)


def _wrong_file(path: Path, kind: str, allowed: str) -> InputError:
    """The error that a file is something else, and how to make the right one."""
    return InputError(str(path), f"is {kind}.", allowed, _SCORE if "score" in allowed else "")
