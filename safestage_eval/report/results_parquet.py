"""Results as a Parquet table with one schema whatever the rows hold."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from itertools import islice
from typing import Any

import pyarrow as pa
import pyarrow.json
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
            writer.write_table(_table(rows))
            yield sink.taken()
    yield sink.taken()


def _table(rows: list[dict[str, Any]]) -> pa.Table:
    """The rows as a table, read from JSON: of Python objects pyarrow makes none without importing pandas."""
    text = "\n".join(json.dumps(row, allow_nan=False) for row in rows).encode()
    return pyarrow.json.read_json(
        io.BytesIO(text),
        pyarrow.json.ReadOptions(use_threads=False, block_size=len(text) + 1),
        pyarrow.json.ParseOptions(explicit_schema=SCHEMA, unexpected_field_behavior="error"),
    )


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
