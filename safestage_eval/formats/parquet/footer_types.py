"""Whether a Parquet footer states the type of each column in one way.

pyarrow ends the process when it is asked for the statistics of a column whose chunk states another
type than the schema. This looks at the types only, in plain Python, for where the compiled parser
of ``footer_kernels`` is not loaded. Field numbers are those of ``parquet.thrift``.
"""

from __future__ import annotations

from collections.abc import Iterator

_DOUBLE, _TEXT, _LIST, _SET, _RECORD = 7, 8, 9, 10, 12
_SCHEMA, _GROUPS, _CHUNKS, _META = 2, 4, 1, 3
_TYPE, _CHILDREN = 1, 5


def types_agree(data: bytes) -> bool:
    """False also for bytes that are no footer."""
    leaves: list[int] = []
    found: list[list[int]] = []
    try:
        for number, kind, at in _fields(data, 0):
            if number == _SCHEMA and kind == _LIST:
                for element in _items(data, at):
                    said = {n: _zigzag(data, a) for n, k, a in _fields(data, element) if k == 5}
                    if not said.get(_CHILDREN):
                        leaves.append(said.get(_TYPE, -1))
            elif number == _GROUPS and kind == _LIST:
                found += [_chunk_types(data, group) for group in _items(data, at)]
    except (IndexError, ValueError, RecursionError):
        return False
    return all(types == leaves for types in found)


def _chunk_types(data: bytes, group: int) -> list[int]:
    """The types that the chunks of a row group state."""
    types = []
    for number, kind, at in _fields(data, group):
        if number != _CHUNKS or kind != _LIST:
            continue
        for chunk in _items(data, at):
            meta = [a for n, k, a in _fields(data, chunk) if n == _META and k == _RECORD]
            if len(meta) != 1:
                raise ValueError("a chunk without description")
            first = next(_fields(data, meta[0]))
            types.append(_zigzag(data, first[2]) if first[:2] == (_TYPE, 5) else -1)
    return types


def _fields(data: bytes, at: int) -> Iterator[tuple[int, int, int]]:
    """Number, kind and place of each field of a record."""
    number = 0
    while head := data[at]:
        at += 1
        if head >> 4:
            number += head >> 4
        else:
            number = _zigzag(data, at)
            at = _after_varint(data, at)
        yield number, head & 15, at
        at = _after(data, at, head & 15)


def _items(data: bytes, at: int) -> Iterator[int]:
    """The place of each record of a list."""
    count, kind, at = _list(data, at)
    if kind != _RECORD:
        raise ValueError("a list of something else")
    for _ in range(count):
        yield at
        at = _after(data, at, kind)


def _list(data: bytes, at: int) -> tuple[int, int, int]:
    """How many items of which kind, and where they begin."""
    head = data[at]
    if head >> 4 < 15:
        return head >> 4, head & 15, at + 1
    end = _after_varint(data, at + 1)
    return _varint(data, at + 1), head & 15, end


def _after(data: bytes, at: int, kind: int) -> int:
    """The place after a value."""
    if kind in (1, 2):
        return at
    if kind == 3:
        return at + 1
    if kind < _DOUBLE:
        return _after_varint(data, at)
    if kind == _DOUBLE:
        return at + 8
    if kind == _TEXT:
        return _after_varint(data, at) + _varint(data, at)
    if kind in (_LIST, _SET):
        count, kind, at = _list(data, at)
        for _ in range(count):
            at = at + 1 if kind < 3 else _after(data, at, kind)
            data[at - 1]  # an IndexError for a count beyond the end
        return at
    if kind != _RECORD:
        raise ValueError("no such kind")
    while head := data[at]:
        at = at + 1 if head >> 4 else _after_varint(data, at + 1)
        at = _after(data, at, head & 15)
    return at + 1


def _after_varint(data: bytes, at: int) -> int:
    while data[at] > 127:
        at += 1
    return at + 1


def _varint(data: bytes, at: int) -> int:
    value = shift = 0
    while data[at] > 127:
        value |= (data[at] & 127) << shift
        shift += 7
        at += 1
    return value | data[at] << shift


def _zigzag(data: bytes, at: int) -> int:
    value = _varint(data, at)
    return (value >> 1) ^ -(value & 1)
