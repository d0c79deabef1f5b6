"""The rows of ``meta/episodes``: what a Parquet dataset says of each of its episodes."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from safestage_eval.errors import TraceError
from safestage_eval.formats.trace_files import check_link

from .arrow_tables import EPISODES, REQUIRED, schema
from .arrow_values import pylist
from .table_file import TableFile

_LAST: list[tuple[Hashable, dict[int, list[dict[str, Any]]]]] = []
"""The file that was read last, and its rows by episode.

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
    table = _table(file)
    if not _LAST or _LAST[0][0] != table.key:
        by_episode: dict[int, list[dict[str, Any]]] = {}
        for row in _rows(table, file):
            by_episode.setdefault(row["episode_index"], []).append(row)
        _LAST[:] = [(table.key, by_episode)]
    rows = _LAST[0][1].get(episode_index, [])
    if len(rows) != 1:
        raise TraceError(str(file), f"{len(rows)} rows with episode_index {episode_index}", "one")
    return rows[0]


def _table(file: Path) -> TableFile:
    check_link(file, file.parents[2], str(file))
    return TableFile(file, "meta/episodes")


def _rows(
    table: TableFile, file: Path, columns: tuple[str, ...] | None = None
) -> list[dict[str, Any]]:
    missing = [name for name in REQUIRED if name not in table.types]
    if missing:
        raise TraceError(str(file), f"the column {missing[0]!r} is missing.", ", ".join(EPISODES))
    wanted = [name for name in columns or EPISODES if name in table.types]
    return _records(table.read(wanted), wanted, file)


def _records(table: pa.Table, columns: Sequence[str], file: Path) -> list[dict[str, Any]]:
    """The rows; raises TraceError for a column of another kind, or a gap where there must be none."""
    for name, values in zip(columns, table.itercolumns(), strict=True):
        wanted = schema("meta/episodes").field(name).type
        other = values.type != wanted and _kind(values.type) != _kind(wanted)
        if other and values.null_count < len(values):
            raise TraceError(str(file), f"the column {name!r} holds {values.type}.", f"{wanted}")
        if name in REQUIRED and values.null_count:
            raise TraceError(str(file), f"{name} is empty in {values.null_count} rows")
    values = [pylist(column) for column in table.itercolumns()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True)]


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
