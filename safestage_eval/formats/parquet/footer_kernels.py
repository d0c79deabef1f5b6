"""The fields of a Parquet file's footer, sorted out by row group and column."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

from .parquet_footer import CODEC, COMPRESSED, DICTIONARY, FIRST_PAGE, TYPE, VALUES
from .thrift import MORE, _list, _signed, _varint, fields, stack

_SCHEMA, _GROUPS = 2, 4
_LIST, _RECORD = 9, 12
_CHUNK, _ROWS = 1, 3
_ELSEWHERE, _ENCRYPTED = _CHUNK * MORE + 1, _CHUNK * MORE + 8
_META = _CHUNK * MORE + 3
_STATISTICS = _META * MORE + 12

_KEPT = np.full(MORE, -1)
_KEPT[[1, 4, 5, 7, 9, 11]] = TYPE, CODEC, VALUES, COMPRESSED, FIRST_PAGE, DICTIONARY
"""Which number of ``Footer.chunks`` a field of a column's metadata becomes."""

MISSING, GREATEST, GREATEST_SIZE, LEAST, LEAST_SIZE, GREATEST_EXACT, LEAST_EXACT = range(7)
"""What is kept of the statistics of a key."""

SAID = 3, 4, 5, 6
"""Fields of an element of the schema that are kept: its repetition, name, number of elements inside,
and meaning."""

_ELEMENTS = 1 << 12
"""Most elements of a schema; the formats here have about thirty."""
_FIELDS = 1 << 16
"""Most fields of one row group: there are some thirty of each column."""
_CHUNK_BYTES = 16
"""Fewest bytes that tell where a column is."""


class Beginning(NamedTuple):
    """What a footer says before it comes to the row groups.

    Attributes:
        elements: (S, 4, 2) value and length of the fields ``SAID`` of each element of the schema.
        place: where the row groups begin.
        groups: how many there are, as it claims.
    """

    elements: NDArray[np.int64]
    place: int
    groups: int


def beginning(data: NDArray[np.uint8]) -> Beginning | None:
    """Of the bytes of a footer; None for bytes that are none."""
    found = np.empty((64, 3), np.int64)
    elements = np.full((_ELEMENTS, len(SAID), 2), -1, np.int64)
    count, place, groups = _begin(data, found, stack(), elements)
    return Beginning(elements[:count].copy(), place, groups) if count > 0 else None


def sorted_out(
    data: NDArray[np.uint8], begin: Beginning, columns: int, keys: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
    """What a footer says about row groups and columns.

    Args:
        data: (N,) the bytes of the footer.
        begin: from ``beginning``.
        columns: how many each row group has.
        keys: (K,) places of columns of which statistics are wanted.

    Returns:
        (G,) rows of a group; (G, C, 6) from ``TYPE`` to ``DICTIONARY``; (G, K, 7) from ``MISSING``
        to ``LEAST_EXACT``, limits by where their bytes are; all -1 where nothing is said. None for
        bytes that are no footer, for more columns than the bytes can tell of, for columns in
        another file, and for a group with more or fewer columns.
    """
    groups = begin.groups
    if not columns or groups * columns * _CHUNK_BYTES > len(data):
        return None
    rows = np.full(groups, -1, np.int64)
    chunks = np.full((groups, columns, DICTIONARY + 1), -1, np.int64)
    statistics = np.full((groups, len(keys), LEAST_EXACT + 1), -1, np.int64)
    found = np.empty((min(len(data), _FIELDS), 3), np.int64)
    known = _groups(data, begin.place, _KEPT, keys, found, stack(), rows, chunks, statistics)
    return (rows, chunks, statistics) if known else None


@kernel
def _begin(data: Any, found: Any, stack: Any, elements: Any) -> Any:
    """Fills the elements; how many there are (-1: no footer), where the row groups begin, their number."""
    at, last, count = np.int64(0), np.int64(0), np.int64(0)
    while at < len(data):
        kind, last, at = _field(data, at, last)
        if at < 0 or kind == 0:
            break
        if kind == _LIST and last in (_SCHEMA, _GROUPS):
            each, size, at = _list(data, at)
            if at < 0 or size < 0 or (size > 0 and each != _RECORD):
                break
            if last == _GROUPS:
                return count, at, size
            if size > len(elements):
                break
            for i in range(size):
                told, at = fields(data, at, found, stack)
                if told < 0:
                    return -1, at, np.int64(0)
                for k in range(told):
                    number = found[k, 0]
                    if SAID[0] <= number <= SAID[3]:
                        elements[i, number - SAID[0], 0] = found[k, 1]
                        elements[i, number - SAID[0], 1] = found[k, 2]
            count = size
        else:
            at = _past(data, at, kind, found, stack)
            if at < 0:
                break
    return np.int64(-1), at, np.int64(0)


@kernel
def _groups(
    data: Any, at: Any, kept: Any, keys: Any, found: Any, stack: Any,
    rows: Any, chunks: Any, statistics: Any,
) -> bool:  # fmt: skip
    """Fills the tables; false for what is no footer, and for columns elsewhere."""
    for g in range(len(rows)):
        count, at = fields(data, at, found, stack)
        if count < 0 or not _group(
            found, count, kept, keys, rows[g : g + 1], chunks[g], statistics[g]
        ):
            return False
    last = np.int64(_GROUPS)
    while at < len(data):
        kind, last, at = _field(data, at, last)
        if at < 0 or kind == 0:
            return bool(at >= 0)
        if kind == _LIST:
            each, size, at = _list(data, at)
            if at < 0 or size < 0 or (size > 0 and each != _RECORD) or last in (_GROUPS, _SCHEMA):
                return False
            for _ in range(size):
                count, at = fields(data, at, found, stack)
                if count < 0:
                    return False
        else:
            at = _past(data, at, kind, found, stack)
            if at < 0:
                return False
    return False


@helper
def _group(
    found: Any, count: Any, kept: Any, keys: Any, rows: Any, chunks: Any, statistics: Any
) -> bool:
    """One row group from its fields; false if it has other columns than expected."""
    chunk, key = -1, -1
    for k in range(count):
        row = found[np.uintp(k)]
        path, value = row[0], row[1]
        record, field = path >> 5, path & 31
        if path == _CHUNK:
            chunk += 1
            if chunk >= len(chunks):
                return False
            key = -1
            for i in range(len(keys)):
                if keys[i] == chunk:
                    key = i
        elif path == _ROWS:
            rows[0] = value
        elif record == _META:
            if kept[field] >= 0 and chunk >= 0:
                chunks[chunk, kept[field]] = value
        elif record == _STATISTICS:
            if key < 0:
                continue
            if field == 3:
                statistics[key, MISSING] = value
            elif field == 5:
                statistics[key, GREATEST] = value
                statistics[key, GREATEST_SIZE] = row[2]
            elif field == 6:
                statistics[key, LEAST] = value
                statistics[key, LEAST_SIZE] = row[2]
            elif field == 7:
                statistics[key, GREATEST_EXACT] = value
            elif field == 8:
                statistics[key, LEAST_EXACT] = value
        elif path in (_ELSEWHERE, _ENCRYPTED):
            return False
    return bool(chunk == len(chunks) - 1)


@helper
def _field(data: Any, at: Any, last: Any) -> Any:
    """The kind of a record's next field (0: none), its number, and where its value begins; -1 for none such."""
    head = np.int64(data[np.uintp(at)])
    at += 1
    if head == 0:
        return head, last, at
    if head >> 4:
        last += head >> 4
    else:
        last, at = _varint(data, at)
        last = _signed(last)
    if not 0 < last < MORE:
        at = np.int64(-1)
    return head & 15, last, at


@helper
def _past(data: Any, at: Any, kind: Any, found: Any, stack: Any) -> Any:
    """Where a value that is no list ends; -1 for what is no value."""
    if 1 <= kind <= 2:
        return at
    if 4 <= kind <= 6:
        _, at = _varint(data, at)
        return at
    if kind == 8:
        size, at = _varint(data, at)
        if at < 0 or not 0 <= size <= len(data) - at:
            return np.int64(-1)
        return at + size
    if kind == _RECORD:
        count, at = fields(data, at, found, stack)
        return at if count >= 0 else np.int64(-1)
    return np.int64(-1)
