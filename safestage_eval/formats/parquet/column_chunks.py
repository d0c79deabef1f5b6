"""Sizes of column chunks, from the footer of a Parquet file.

pyarrow ends the process when it is asked for that in a footer that contradicts itself: its column
chunks are made by C++ code whose exceptions nobody catches (statistics of another type than the
schema's, histograms of other sizes, fewer chunks than columns, encrypted ones). So pyarrow is never
asked: the footer, a record in Thrift's compact protocol
(https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md), is read here,
of fields by the numbers of Parquet's format (https://github.com/apache/parquet-format).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

_TRUE, _BYTE, _DOUBLE, _BYTES, _LIST, _SET, _MAP, _RECORD, _UUID = 1, 3, 7, 8, 9, 10, 11, 12, 13
_WHOLE = (4, 5, 6)
"""Thrift's integers of 16, 32 and 64 bits."""

_FIXED = {_BYTE: 1, _DOUBLE: 8, _UUID: 16}
"""Kind → bytes of a value."""

_DEEPEST = 64
"""How far values may lie inside each other, as for Arrow; those of a footer are seven deep."""

_Wanted = Mapping[int, Any]
"""Number of a field → what of it is read: itself (None), or of its record or records."""

_STATISTICS = {3: None, 5: None, 6: None}
_COLUMN = {1: None, 5: None, 12: _STATISTICS}
_FOOTER: _Wanted = {4: {1: {3: _COLUMN}}}
"""Row groups, their columns, and the metadata of these."""

PHYSICAL_TYPES = (
    "BOOLEAN", "INT32", "INT64", "INT96", "FLOAT", "DOUBLE", "BYTE_ARRAY", "FIXED_LEN_BYTE_ARRAY",
)  # fmt: skip
"""By their number; pyarrow's names."""


class Chunk(NamedTuple):
    """A column of a row group.

    Attributes:
        physical_type: of its values; None where it is not stated.
        values: how many there are, those within lists counted one by one.
        least, greatest: encoded as values are; None where they are not stated.
        nulls: values that are missing, as far as it is stated.
    """

    physical_type: str | None
    values: int
    least: bytes | None
    greatest: bytes | None
    nulls: int


def read_chunks(footer: bytes) -> list[list[Chunk]]:
    """Return the columns of each row group, in the footer's order.

    Args:
        footer: without its length and the mark behind it.

    Raises:
        ValueError: it breaks off, or is nested without end.
    """
    try:
        groups = _record(footer, 0, _FOOTER, 0)[0].get(4, [])
    except IndexError:
        raise ValueError("the footer breaks off") from None
    return [[_chunk(column.get(3, {})) for column in group.get(1, [])] for group in groups]


def read_chunks_of(path: Path, footer_size: int) -> list[list[Chunk]]:
    """Return the columns of each row group of a local file; raises as ``read_chunks``, and OSError.

    Args:
        path: of the file.
        footer_size: bytes, as pyarrow's ``FileMetaData.serialized_size``.
    """
    with path.open("rb") as stream:
        stream.seek(-8 - footer_size, 2)
        return read_chunks(stream.read(footer_size))


def _chunk(stated: dict[int, Any]) -> Chunk:
    number, statistics = stated.get(1, -1), stated.get(12, {})
    return Chunk(
        PHYSICAL_TYPES[number] if 0 <= number < len(PHYSICAL_TYPES) else None,
        stated.get(5, 0),
        statistics.get(6),
        statistics.get(5),
        statistics.get(3, 0),
    )


def _record(data: bytes, at: int, wanted: _Wanted, depth: int) -> tuple[dict[int, Any], int]:
    """The wanted fields of a record, and where it ends. Of a field that is there twice, the last."""
    fields: dict[int, Any] = {}
    number = 0
    while head := data[at]:
        at += 1
        kind = head & 15
        if head >> 4:
            number += head >> 4
        else:
            number, at = _whole(data, at)
        if number not in wanted:
            if kind in _WHOLE:  # as most are, so that it is done without a call
                while data[at] > 127:
                    at += 1
                at += 1
            elif kind == _BYTES and data[at] <= 127:
                at += 1 + data[at]
            else:
                at = _behind(data, at, kind, depth)
            continue
        inner = wanted[number]
        if inner is None and kind in _WHOLE:
            fields[number], at = _whole(data, at)
        elif inner is None and kind == _BYTES:
            size, at = _count(data, at)
            fields[number], at = data[at : at + size], at + size
        elif inner is not None and kind == _RECORD:
            fields[number], at = _record(data, at, inner, _deeper(depth))
        elif inner is not None and kind == _LIST:
            fields[number], at = _records(data, at, inner, _deeper(depth))
        else:
            at = _behind(data, at, kind, depth)
    return fields, at + 1


def _records(data: bytes, at: int, wanted: _Wanted, depth: int) -> tuple[list[dict[int, Any]], int]:
    """The records of a list, and where it ends; Thrift does not look at the kind that it states."""
    size, _, at = _list_head(data, at)
    found = []
    for _ in range(size):
        record, at = _record(data, at, wanted, depth)
        found.append(record)
    return found, at


def _behind(data: bytes, at: int, kind: int, depth: int) -> int:
    """Where a value ends that nobody asks for."""
    if kind in _WHOLE:
        while data[at] > 127:
            at += 1
        return at + 1
    if kind == _BYTES:
        size, at = _count(data, at)
        return at + size
    if kind == _RECORD:
        return _record(data, at, {}, _deeper(depth))[1]
    if kind in _FIXED:
        return at + _FIXED[kind]
    if kind in (_LIST, _SET):
        size, inner, at = _list_head(data, at)
        if inner in _WHOLE:
            for _ in range(size):
                while data[at] > 127:
                    at += 1
                at += 1
            return at
        for _ in range(size):
            at = _behind_element(data, at, inner, _deeper(depth))
        return at
    if kind == _MAP:
        size, at = _count(data, at)
        if size:
            kinds, at = data[at], at + 1
            for _ in range(size):
                at = _behind_element(data, at, kinds >> 4, _deeper(depth))
                at = _behind_element(data, at, kinds & 15, _deeper(depth))
        return at
    if kind in (_TRUE, _TRUE + 1):
        return at
    raise ValueError(f"the footer has a value of the unknown kind {kind}")


def _behind_element(data: bytes, at: int, kind: int, depth: int) -> int:
    """Like ``_behind``, within lists, where booleans take a byte each."""
    if at >= len(data):
        raise IndexError
    return at + 1 if kind in (_TRUE, _TRUE + 1) else _behind(data, at, kind, depth)


def _list_head(data: bytes, at: int) -> tuple[int, int, int]:
    """How many elements, of which kind, and where the first one begins."""
    head = data[at]
    if head >> 4 < 15:
        return head >> 4, head & 15, at + 1
    size, at = _count(data, at + 1)
    return size, head & 15, at


def _count(data: bytes, at: int) -> tuple[int, int]:
    """A number that is not negative: seven bits per byte, the lowest first."""
    number = shift = 0
    while (byte := data[at]) > 127:
        number |= (byte & 127) << shift
        shift += 7
        at += 1
        if shift > 63:
            raise ValueError("the footer has a number of more than 64 bits")
    return number | byte << shift, at + 1


def _whole(data: bytes, at: int) -> tuple[int, int]:
    """A number that may be negative."""
    number, at = _count(data, at)
    return (number >> 1) ^ -(number & 1), at


def _deeper(depth: int) -> int:
    if depth == _DEEPEST:
        raise ValueError(f"the footer has values more than {_DEEPEST} deep inside each other")
    return depth + 1
