"""The rows of ``meta/episodes``: what a Parquet dataset says of each of its episodes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from safestage_eval.errors import TraceError
from safestage_eval.formats.trace_files import check_link

from .arrow_tables import EPISODES, REQUIRED, schema
from .stored_table import StoredTable
from .table_file import Footer

_LAST: list[tuple[Footer, dict[int, list[dict[str, Any]]]]] = []
"""The footer of the file that was read last, and its rows by episode.

Episodes of a file are mostly opened one after the other, and it may tell of hundreds of them.
"""


def read_rows(file: Path, columns: tuple[str, ...] | None = None) -> list[dict[str, Any]]:
    """Read the rows of one file of ``meta/episodes``; columns that it lacks are left out.

    Raises:
        TraceError: unreadable, without a required column, or of a newer major version.
    """
    return _rows(_table(file), file, columns)


def read_row(file: Path, episode_index: int) -> dict[str, Any]:
    """Read the row of one episode from a file of ``meta/episodes``.

    Raises:
        TraceError: as ``read_rows``, or no row has this index, or several have.
    """
    rows = _by_episode(_table(file), file).get(episode_index, [])
    if len(rows) != 1:
        raise TraceError(str(file), f"{len(rows)} rows with episode_index {episode_index}", "one")
    return rows[0]


def _table(file: Path) -> StoredTable:
    check_link(file, file.parents[2], str(file))
    return StoredTable(file, "meta/episodes")


def _by_episode(table: StoredTable, file: Path) -> dict[int, list[dict[str, Any]]]:
    for footer, rows in _LAST:
        if footer is table.footer:
            return rows
    rows_by_episode: dict[int, list[dict[str, Any]]] = {}
    for row in _rows(table, file):
        rows_by_episode.setdefault(row["episode_index"], []).append(row)
    _LAST[:] = [(table.footer, rows_by_episode)]
    return rows_by_episode


def _rows(
    table: StoredTable, file: Path, columns: tuple[str, ...] | None = None
) -> list[dict[str, Any]]:
    there = table.footer.layout.types
    missing = [name for name in REQUIRED if name not in there]
    if missing:
        raise TraceError(str(file), f"the column {missing[0]!r} is missing.", ", ".join(EPISODES))
    wanted = [name for name in columns or EPISODES if name in there]
    return _records(table.all(wanted), wanted, file)


def _records(table: pa.Table, columns: Sequence[str], file: Path) -> list[dict[str, Any]]:
    """The rows; raises TraceError for a column of another kind, or a gap where there must be none."""
    for name, values in zip(columns, table.itercolumns(), strict=True):
        wanted = schema("meta/episodes").field(name).type
        other = values.type != wanted and _kind(values.type) != _kind(wanted)
        if other and values.null_count < len(values):
            raise TraceError(str(file), f"the column {name!r} holds {values.type}.", f"{wanted}")
        if name in REQUIRED and values.null_count:
            raise TraceError(str(file), f"{name} is empty in {values.null_count} rows")
    rows: list[dict[str, Any]] = table.to_pylist()
    return rows


def _kind(kind: pa.DataType) -> str:
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    if pa.types.is_integer(kind):
        return "int"
    if pa.types.is_floating(kind):
        return "float"
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return "str"
    if pa.types.is_list(kind) or pa.types.is_large_list(kind):
        return f"list of {_kind(kind.value_type)}"
    return str(kind)
