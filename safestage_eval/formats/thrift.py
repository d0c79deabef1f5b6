"""Thrift's compact protocol, in which Parquet writes its footer and the headers of its pages.

As specified in "Thrift Compact protocol encoding" (Apache Thrift, doc/specs).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.compiled import helper, kernel

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
    while at < len(data) and shift < 64:
        byte = np.int64(data[at])
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
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, -1, 0
    while at < len(data):
        if stack[depth, 2] == 0:
            depth -= 1
            continue
        path = stack[depth, 0]
        if stack[depth, 2] > 0:
            stack[depth, 2] -= 1
            kind = stack[depth, 3]
            if kind <= 2:  # a truth value takes a byte here, and none in a record
                kind = 3
        else:
            head = np.int64(data[at])
            at += 1
            if head == 0:
                if depth == 0:
                    return count, at
                depth -= 1
                continue
            kind = head & 15
            if head >> 4:
                number = stack[depth, 1] + (head >> 4)
            else:
                number, at = _varint(data, at)
                number = _signed(number)
                if at < 0:
                    return -1, at
            if not 0 < number < MORE:
                return -1, at
            stack[depth, 1] = number
            path = path * MORE + number
        value: Any = np.int64(0)
        length: Any = np.int64(0)
        if kind <= 2:
            value = np.int64(kind == 1)
        elif kind == 3:
            if at >= len(data):
                return -1, at
            value = np.int64(data[at])
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
            if at >= len(data):
                return -1, at
            head = np.int64(data[at])
            at += 1
            size = head >> 4
            if size == 15:
                size, at = _varint(data, at)
            depth += 1
            if at < 0 or size < 0 or depth >= DEEPEST:
                return -1, at
            stack[depth, 0], stack[depth, 1] = path, 0
            stack[depth, 2], stack[depth, 3] = size, head & 15
            continue
        elif kind == 12:
            depth += 1
            if depth >= DEEPEST:
                return -1, at
            stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3] = path, 0, -1, 0
        else:
            return -1, at
        if at < 0 or count >= len(found):
            return -1, at
        found[count, 0], found[count, 1], found[count, 2] = path, value, length
        count += 1
    return -1, at
