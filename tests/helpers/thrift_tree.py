"""Records in Thrift's compact protocol as trees that can be altered and written again.

https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md
"""

from __future__ import annotations

from typing import NamedTuple

TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, TEXT, LIST, SET, RECORD = (
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    8,
    9,
    10,
    12,
)


class Node(NamedTuple):
    """A value: of a list, ``value`` is its elements; of a record, pairs of number and node."""

    kind: int
    value: object


def read(data: bytes, at: int = 0) -> tuple[Node, int]:
    """A record, and where it ends."""
    fields, last = [], 0
    while data[at]:
        head = data[at]
        at += 1
        if head >> 4:
            last += head >> 4
        else:
            last, at = _zigzag(data, at)
        node, at = _value(data, at, head & 15)
        fields.append((last, node))
    return Node(RECORD, fields), at + 1


def write(node: Node) -> bytes:
    """The bytes of a record."""
    out, last = bytearray(), 0
    for number, field in node.value:
        if 0 < number - last < 16:
            out.append((number - last) << 4 | field.kind)
        else:
            out.append(field.kind)
            out += zigzag(number)
        last = number
        if field.kind not in (TRUE, FALSE):
            out += _written(field)
    return bytes(out) + b"\0"


def varint(n: int) -> bytes:
    """Seven bits per byte, of 64 bits."""
    n &= 2**64 - 1
    out = bytearray()
    while n > 127:
        out.append(n & 127 | 128)
        n >>= 7
    return bytes([*out, n])


def zigzag(n: int) -> bytes:
    """A number that may be negative."""
    return varint((n << 1) ^ (n >> 63))


def _varint(data: bytes, at: int) -> tuple[int, int]:
    n = shift = 0
    while True:
        n |= (data[at] & 127) << shift
        at += 1
        shift += 7
        if data[at - 1] < 128:
            return n, at


def _zigzag(data: bytes, at: int) -> tuple[int, int]:
    n, at = _varint(data, at)
    return (n >> 1) ^ -(n & 1), at


def _value(data: bytes, at: int, kind: int) -> tuple[Node, int]:
    if kind in (TRUE, FALSE):
        return Node(kind, None), at
    if kind == BYTE:
        return Node(kind, data[at]), at + 1
    if kind in (I16, I32, I64):
        n, at = _zigzag(data, at)
        return Node(kind, n), at
    if kind == DOUBLE:
        return Node(kind, data[at : at + 8]), at + 8
    if kind == TEXT:
        size, at = _varint(data, at)
        return Node(kind, data[at : at + size]), at + size
    if kind in (LIST, SET):
        head = data[at]
        size, at = (head >> 4, at + 1) if head >> 4 < 15 else _varint(data, at + 1)
        items = []
        for _ in range(size):
            if head & 15 in (TRUE, FALSE):
                items.append(Node(head & 15, data[at]))
                at += 1
            else:
                item, at = _value(data, at, head & 15)
                items.append(item)
        return Node(kind, (head & 15, items)), at
    if kind == RECORD:
        return read(data, at)
    raise ValueError(kind)


def _written(node: Node) -> bytes:
    value = node.value
    if node.kind in (TRUE, FALSE, BYTE):
        return bytes([value & 255])
    if node.kind in (I16, I32, I64):
        return zigzag(value)
    if node.kind == DOUBLE:
        return value
    if node.kind == TEXT:
        return varint(len(value)) + value
    if node.kind in (LIST, SET):
        kind, items = value
        size = len(items)
        head = bytes([size << 4 | kind]) if size < 15 else bytes([0xF0 | kind]) + varint(size)
        return head + b"".join(map(_written, items))
    return write(node)
