"""Writing a table of a dataset: one Parquet file with its row-group index."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from .arrow_tables import arrow_file, schema, write_options
from .row_index import METADATA_KEY, Run, encode_row_index


class TableWriter:
    """A file that is being written; made by ``writing_table``."""

    def __init__(self, sink: pa.NativeFile, writer: pq.ParquetWriter) -> None:
        """Take an open file."""
        self._sink, self._writer = sink, writer
        self._groups: list[Sequence[Run]] = []

    def add(self, group: pa.Table, runs: Sequence[Run]) -> None:
        """Write a row group, unless it is empty.

        Args:
            group: its rows.
            runs: of them, from ``row_index.runs_of``.
        """
        if len(group):
            self._writer.write_table(group, row_group_size=len(group))
            self._groups.append(runs)

    def finish(self) -> None:
        """Add the row-group index."""
        index = encode_row_index(self._groups, self._sink.tell())
        self._writer.add_key_value_metadata({METADATA_KEY: index})


@contextmanager
def writing_table(path: Path, table: str) -> Iterator[TableWriter]:
    """Open a new file of a table; one without row groups has the schema only."""
    with (
        arrow_file(path, "wb") as sink,
        pq.ParquetWriter(sink, schema(table), **write_options(table)) as writer,
    ):
        out = TableWriter(sink, writer)
        yield out
        out.finish()


def write_whole(path: Path, table: str, rows: pa.Table) -> None:
    """Write a table that is always read whole, which needs no index."""
    with arrow_file(path, "wb") as sink:
        pq.write_table(rows, sink, **write_options(table))
