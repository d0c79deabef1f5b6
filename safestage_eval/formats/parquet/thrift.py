"""Thrift's compact protocol, in which Parquet writes its footer and the headers of its pages.

As specified in "Thrift Compact protocol encoding" (Apache Thrift, doc/specs).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import helper, kernel

DEEPEST = 16
"""Levels of nested records and lists."""

MORE = 32
"""A field's path is its parent's times this, plus its own number, which must be lower."""


def stack() -> NDArray[np.int64]:
    """Room for ``fields`` to work in."""
    return np.zeros((DEEPEST, 4), np.int64)


@helper
def _varint(data: Any, at: Any) -> Any:
    """A number of seven bits per byte, and what follows it; -1 past the end."""
    value, shift = np.int64(0), np.int64(0)
    while np.uintp(at) < np.uintp(len(data)) and shift < 64:
        byte = np.int64(data[np.uintp(at)])  # an index without sign need not be looked at
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
    return value, -1


@helper
def _signed(value: Any) -> Any:
    """From zigzag, which counts 0, -1, 1, -2 and so on."""
    return ((value >> 1) & 0x7FFFFFFFFFFFFFFF) ^ -(value & 1)


@kernel
def fields(data: Any, at: Any, found: Any, stack: Any) -> Any:
    """What a record says, field by field, and where it ends.

    Args:
        data: (N,) uint8.
        at: where the record starts.
        found: (M, 3) int64 to be filled: path, value, and the length of what is text. The value of
            text is where it starts; that of a record, and of each record of a list, is 0. Elements
            of a list have the path of the list.
        stack: from ``stack``.

    Returns:
        How many rows of ``found`` are filled, and the place after the record; -1 for bytes that are
        no such record, and for maps.
    """
    # a level: its path, the last field's number, how many elements are left (-1: a record), their kind
    depth, count = 0, 0
    within, last, left, each = np.int64(0), np.int64(0), np.int64(-1), np.int64(0)
    while at < len(data):
        if left == 0:
            depth -= 1
            within, last, left, each = _level(stack, depth)
            continue
        path = within
        if left > 0:
            left -= 1
            kind = each
            if kind <= 2:  # a truth value takes a byte here, and none in a record
                kind = np.int64(3)
        else:
            head = np.int64(data[np.uintp(at)])
            at += 1
            if head == 0:
                if depth == 0:
                    return count, at
                depth -= 1
                within, last, left, each = _level(stack, depth)
                continue
            kind = head & 15
            if head >> 4:
                last += head >> 4
            else:
                last, at = _varint(data, at)
                last = _signed(last)
                if at < 0:
                    return -1, at
            if not 0 < last < MORE:
                return -1, at
            path = within * MORE + last
        value: Any = np.int64(0)
        length: Any = np.int64(0)
        size: Any = np.int64(-1)
        inner: Any = np.int64(0)
        if kind <= 2:
            value = np.int64(kind == 1)
        elif kind == 3:
            if at >= len(data):
                return -1, at
            value = np.int64(data[np.uintp(at)])
            at += 1
        elif kind <= 6:
            value, at = _varint(data, at)
            value = _signed(value)
        elif kind == 7:
            value = np.int64(at)
            at += 8
        elif kind == 8:
            length, at = _varint(data, at)
            value = np.int64(at)
            if at < 0 or not 0 <= length <= len(data) - at:
                return -1, at
            at += length
        elif kind in (9, 10):
            inner, size, at = _list(data, at)
            if at < 0 or size < 0:
                return -1, at
        elif kind != 12:
            return -1, at
        if kind not in (9, 10):
            if at < 0 or count >= len(found):
                return -1, at
            row = found[np.uintp(count)]
            row[0], row[1], row[2] = path, value, length
            count += 1
        if kind >= 9:
            if depth + 1 >= DEEPEST:
                return -1, at
            level = stack[np.uintp(depth)]
            level[0], level[1], level[2], level[3] = within, last, left, each
            depth += 1
            within, last, left, each = path, np.int64(0), size, inner
    return -1, at


@helper
def _level(stack: Any, depth: Any) -> Any:
    """A level as it was left."""
    level = stack[np.uintp(depth)]
    return level[0], level[1], level[2], level[3]


@helper
def _list(data: Any, at: Any) -> Any:
    """The kind of a list's elements, how many, and where they begin; -1 past the end."""
    if np.uintp(at) >= np.uintp(len(data)):
        return np.int64(0), np.int64(-1), -1
    head = np.int64(data[np.uintp(at)])
    at += 1
    size = head >> 4
    if size == 15:
        size, at = _varint(data, at)
    return head & 15, size, at
