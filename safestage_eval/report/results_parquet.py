"""Results as a Parquet table with one schema whatever the rows hold."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import islice
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from safestage_eval.run.scores import Scores

from .result_rows import COLUMNS, KINDS, each_row

_TYPES = {
    "integer": pa.int64(), "boolean": pa.bool_(), "number": pa.float64(),
    "strings": pa.list_(pa.string()), "pairs": pa.list_(pa.list_(pa.float64())),
}  # fmt: skip

SCHEMA = pa.schema(
    [(name, _TYPES[KINDS[name]] if name in KINDS else pa.string()) for name in COLUMNS]
)

_GROUP = 10_000
"""Rows of a row group."""


def pieces(scores: Scores) -> Iterator[bytes]:
    """The bytes of a Parquet file, a row group at a time."""
    sink = _Sink()
    rest = each_row(scores)
    with pq.ParquetWriter(pa.PythonFile(sink, "w"), SCHEMA, compression="zstd") as writer:
        while rows := list(islice(rest, _GROUP)):
            writer.write_table(pa.Table.from_pylist(rows, schema=SCHEMA))
            yield sink.taken()
    yield sink.taken()


class _Sink(io.RawIOBase):
    """Bytes that were written and not taken yet."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._parts.append(bytes(data))
        return len(self._parts[-1])

    def taken(self) -> bytes:
        result = b"".join(self._parts)
        self._parts.clear()
        return result
