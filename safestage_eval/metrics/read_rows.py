"""Tables in files, row by row: JSON, JSON lines, CSV and Parquet, found from their content."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, TextIO

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
_HALF = "\\ud"
"""A surrogate pair as JSON may escape it."""
_SAID = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}


def read_rows(
    path: str | Path, columns: Collection[str] | None = None, allowed: str = ALLOWED
) -> list[dict[str, Any]]:
    """Read all rows of a table, as ``each_row`` reads them."""
    return list(each_row(path, columns, allowed))


def each_row(
    path: str | Path, columns: Collection[str] | None = None, allowed: str = ALLOWED
) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table, one after the other; of a JSON object with ``episodes``, those.

    A table is never in memory as a whole, unless it is one JSON document.

    Args:
        path: the file.
        columns: those needed; other columns of a Parquet file are not read.
        allowed: for messages: what is accepted.

    Raises InputError for a file that cannot be read, or whose cells cannot be what they must be.
    """
    try:
        with Path(path).open("rb") as file:
            beginning = file.read(4096)
            file.seek(0)
            refuse_other_files(Path(path), beginning, allowed)
            rows = (
                _parquet(Path(path), columns, allowed)
                if beginning.startswith(b"PAR1")
                else _text(Path(path), file, columns, allowed)
            )
            for number, row in enumerate(rows, 1):
                yield _checked(str(path), number, row)
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}.", allowed) from None
    except UnicodeDecodeError:
        raise InputError(str(path), "not a table.", allowed) from None


def _checked(where: str, number: int, row: dict[str, Any]) -> dict[str, Any]:
    """Return the row. Raises InputError for a list where none belongs, or a number that is none."""
    for name, value in row.items():
        kind = type(value)
        if kind is int:
            wrong = abs(value) >= 2**63
        elif name in _NUMBERS:
            wrong = value is not None and kind is not float
        else:
            wrong = kind is dict or (kind is list and name not in _LISTS)
        if wrong:
            allowed = "a number" if name in _NUMBERS else "text or a number"
            raise InputError(f"{where}, row {number}", f"{name} is {str(value)[:60]}.", allowed)
    return row


def _whole_characters(where: str, number: int, row: dict[str, Any]) -> None:
    """Raises InputError for half of a pair of UTF-16 in JSON, which no file can hold as text."""
    try:
        json.dumps(row, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InputError(f"{where}, row {number}", "it has half of a character.") from None


def truth(value: Any, where: str, name: str) -> bool | None:
    """Read a cell that says yes or no; None where it is empty. Raises InputError for anything else."""
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


def demand_columns(
    row: Mapping[str, Any], columns: Iterable[str], where: str, allowed: str
) -> None:
    """Raise InputError where a row lacks a column; ``allowed``: what is accepted, for the message."""
    missing = [name for name in columns if name not in row]
    if missing:
        raise InputError(where, f"lacks {', '.join(missing)}.", allowed)


def cell_text(value: Any) -> str:
    """Write a cell as text without spaces around it; empty for None and NaN."""
    return "" if value is None or value != value else str(value).strip()  # noqa: PLR0124 (NaN)


def _parquet(path: Path, columns: Collection[str] | None, allowed: str) -> Iterator[dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(pa.OSFile(os.fsencode(path)))
        wanted = None
        if columns is not None:
            refuse_other_columns(path, file.schema_arrow.names, columns, allowed)
            wanted = [name for name in file.schema_arrow.names if name in columns]
        for batch in file.iter_batches(BATCH, columns=wanted):
            yield from batch.to_pylist()
    except (pa.ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(str(path), f"a broken Parquet file: {error}.", allowed) from None


def _text(
    path: Path, file: BinaryIO, columns: Collection[str] | None, allowed: str
) -> Iterator[dict[str, Any]]:
    """JSON, JSON lines or CSV, recognised by the first line that is not empty."""
    where = str(path)
    first, start = "", 0
    for line in file:
        first = (first + line.decode("utf-8-sig" if start == 0 else "utf-8")).strip()
        start += len(line)
        if first:
            break
    if not first:
        raise wrong_file(path, "an empty file", allowed)
    last = not any(line.strip() for line in file)
    file.seek(0)
    table = not first.startswith(("{", "["))
    with io.TextIOWrapper(file, "utf-8-sig", newline="" if table else "\n") as text:
        if table:
            yield from _csv(path, text, columns, allowed)
        elif not last and _is_object(first):
            yield from _lines(where, text, allowed)
        else:
            yield from _document(path, text.read(), columns, allowed)


def _is_object(line: str) -> bool:
    """Whether a line is a whole JSON object."""
    try:
        return isinstance(from_json(line), dict)
    except json.JSONDecodeError:
        return False


def _document(
    path: Path, text: str, columns: Collection[str] | None, allowed: str
) -> Iterable[dict[str, Any]]:
    where = str(path)
    try:
        whole = from_json(text)
    except json.JSONDecodeError:
        return _lines(where, io.StringIO(text, newline="\n"), allowed)
    rows = whole.get("episodes", [whole]) if isinstance(whole, dict) else whole
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise wrong_file(path, "JSON, but no results", allowed)
    if rows:
        refuse_other_columns(path, rows[0], columns, allowed)
    if _HALF in text.lower():
        for number, row in enumerate(rows, 1):
            _whole_characters(where, number, row)
    return rows


def _lines(where: str, text: TextIO, allowed: str) -> Iterator[dict[str, Any]]:
    read = 0
    for number, line in enumerate(text, 1):
        if line.strip():
            try:
                row = from_json(line)
            except json.JSONDecodeError as error:
                raise InputError(
                    f"{where}, line {number}", f"not JSON: {error.msg}.", allowed
                ) from None
            if not isinstance(row, dict):
                raise InputError(f"{where}, line {number}", "not a result row.", allowed)
            read += 1
            if _HALF in line.lower():
                _whole_characters(where, read, row)
            yield row


def _csv(
    path: Path, text: TextIO, columns: Collection[str] | None, allowed: str
) -> Iterator[dict[str, Any]]:
    where = str(path)
    try:
        table = csv.DictReader(text)
        refuse_other_columns(path, table.fieldnames or (), columns, allowed)
        for number, entry in enumerate(table, 1):
            row = {name: from_cell(x) if isinstance(x, str) else x for name, x in entry.items()}
            place = f"{where}, row {number}"
            if row.get(None):
                raise InputError(place, "it has more cells than there are columns.")
            yield {name: _cell(place, name, value) for name, value in row.items()}
    except csv.Error as error:
        raise InputError(where, f"not readable as CSV: {error}.") from None


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


_BEGINNINGS = {
    MCAP_MAGIC: "a recording (MCAP)",
    b"PK\x03\x04": "a ZIP file, as of safestage-record",
    b"\x89HDF": "an HDF5 file",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"GIF8": "a picture",
    b"RIFF": "a picture, film or sound",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "compressed",
    b"\x28\xb5\x2f\xfd": "compressed",
    b"<svg": "a picture",
    b"<!doctype": "a web page",
    b"<": "XML, as of --format junit",
}
_TOML = re.compile(rb"(?:\s*(?:#[^\n]*)?\n)*(?:\s*\[\[?[\w.]+\]\]?\s*(?:#[^\n]*)?\n|format *= *1)")
_SCORE = "safestage score TRACES --format parquet --output rows.parquet writes results"


def refuse_other_files(path: Path, beginning: bytes, allowed: str) -> None:
    """Raise InputError, which says what it is, for a file that is no table by its first bytes or its place."""
    text = beginning.removeprefix(b"\xef\xbb\xbf").lstrip()
    kind = next(
        (
            kind
            for magic, kind in _BEGINNINGS.items()
            if beginning.startswith(magic) or text[:9].lower().startswith(magic)
        ),
        "",
    )
    if not beginning:
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
        raise wrong_file(path, kind, allowed)


def refuse_other_columns(
    path: Path, names: Collection[str], wanted: Collection[str] | None, allowed: str
) -> None:
    """Raise InputError for a table, or a text, whose columns are none of those that are wanted."""
    if wanted is not None and not set(names) & set(wanted):
        first = ", ".join(names)[:60]
        raise wrong_file(path, f"text, or a table of something else: {first!r}", allowed)


def wrong_file(path: Path, kind: str, allowed: str) -> InputError:
    """The error that a file is something else, and how to make the right one."""
    return InputError(str(path), f"is {kind}.", allowed, _SCORE if "score" in allowed else "")
