"""The fields of a Parquet file's footer, sorted out by column."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.compiled import kernel

from .thrift import MORE, fields, stack

_SCHEMA, _GROUP = 2, 4
_ROWS = _GROUP * MORE + 3
_CHUNK = _GROUP * MORE + 1
_META = _CHUNK * MORE + 3
_STATISTICS = _META * MORE + 12
FIELDS = 16
"""Fields of a column's metadata that are kept, by number."""
FIRST, LAST = 3, 8
"""Likewise of its statistics: values missing, (distinct), greatest, least, whether both are exact."""
_ELEMENTS = 1 << 12
"""Most elements of a schema; the formats here have about thirty."""
_CHUNK_BYTES = 16
"""Fewest bytes that tell where a column is."""
_ELSEWHERE, _ENCRYPTED = _CHUNK * MORE + 1, _CHUNK * MORE + 8


def tables(data: NDArray[np.uint8]) -> tuple[NDArray[np.int64], ...] | None:
    """What a footer says about elements of the schema, row groups and columns.

    Args:
        data: (N,) the bytes of the footer.

    Returns:
        (S, 32, 2) value and length of each field of an element; (G,) rows of a group; (C, 16)
        values of each column's metadata; (C, 6, 2) of its statistics; all -1 where nothing is
        said. None for bytes that are no footer, for more columns than the bytes can tell of, and
        for columns in another file.
    """
    found = np.empty((len(data), 3), np.int64)
    count, _ = fields(data, 0, found, stack())
    if count < 0:
        return None
    found = found[:count]
    sizes = np.zeros(3, np.int64)
    _count(found, sizes)
    if not 0 < sizes[0] <= _ELEMENTS or sizes[2] * _CHUNK_BYTES > len(data):
        return None
    schema = np.full((sizes[0], MORE, 2), -1, np.int64)
    rows = np.full(sizes[1], -1, np.int64)
    chunks = np.full((sizes[2], FIELDS), -1, np.int64)
    statistics = np.full((sizes[2], LAST - FIRST + 1, 2), -1, np.int64)
    known = _sort(found, schema, rows, chunks, statistics)
    return (schema, rows, chunks, statistics) if known else None


@kernel
def _count(found: Any, sizes: Any) -> None:
    """How many elements of the schema, row groups and columns there are (3,)."""
    for i in range(len(found)):
        path = found[i, 0]
        if path == _SCHEMA:
            sizes[0] += 1
        elif path == _GROUP:
            sizes[1] += 1
        elif path == _CHUNK:
            sizes[2] += 1


@kernel
def _sort(found: Any, schema: Any, rows: Any, chunks: Any, statistics: Any) -> bool:
    """Fill the tables; false for columns elsewhere."""
    element, group, chunk = -1, -1, -1  # whatever comes before the first is the last one's
    for i in range(len(found)):
        path, value = found[i, 0], found[i, 1]
        record, field = path >> 5, path & 31
        if path == _SCHEMA:
            element += 1
        elif path == _GROUP:
            group += 1
        elif path == _CHUNK:
            chunk += 1
        elif record == _SCHEMA:
            schema[element, field, 0], schema[element, field, 1] = value, found[i, 2]
        elif path == _ROWS:
            rows[group] = value
        elif record == _META and field < FIELDS:
            chunks[chunk, field] = value
        elif record == _STATISTICS and FIRST <= field <= LAST:
            statistics[chunk, field - FIRST, 0] = value
            statistics[chunk, field - FIRST, 1] = found[i, 2]
        elif path in (_ELSEWHERE, _ENCRYPTED):
            return False
    return True
