"""Values of small tables' pages: numbers, names by their place in a dictionary, and how they nest.

After the specification of the Parquet format (Encodings.md: RLE/bit-packing hybrid, dictionary
encoding; README: nested encoding). Whatever is met beyond that is told apart, and left to others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval._process.compiled import helper, kernel

from .page_kernels import (
    _RLE,
    BEGIN,
    COLUMN,
    COUNT,
    DELTA,
    ENCODING,
    PACKED,
    SIZE,
    SPLIT,
    _deltas,
    _split_long,
    told,
)
from .thrift import _varint, fields

PLAIN, NAMES = 0, 8
"""Encodings: of truth values and of dictionaries, and of places in a dictionary."""
_SWOLLEN = 256
"""Times its own size that a page may unpack to: what an LZ4 block can do at most."""


@kernel
def find_all_pages(data: Any, chunks: Any, found: Any, stack: Any, pages: Any) -> int:
    """The pages of some columns, dictionaries among them.

    Args:
        data: (N,) uint8.
        chunks: (C, 3) where each column's bytes begin and end, and how many values it has.
        found: room for ``thrift.fields``.
        stack: likewise.
        pages: (P, 7) int64 to be filled, as by ``find_pages``; the encoding of a dictionary is
            ``PLAIN - 1``.

    Returns:
        How many pages there are; -1 for pages of another kind, or that are not whole.
    """
    total = 0
    for column in range(len(chunks)):
        at, end, rest = chunks[column, 0], chunks[column, 1], chunks[column, 2]
        first = True
        while rest > 0:
            count, at = fields(data[:end], at, found, stack)
            if count < 0 or total >= len(pages):
                return -1
            page = pages[total]
            kind, levels, names = told(found, count, page)
            page[BEGIN], page[COLUMN] = at, column
            if kind == 2 and first and names in (0, 2):
                page[ENCODING] = PLAIN - 1
            elif kind != 0 or levels != _RLE or not 0 < page[COUNT] <= rest:
                return -1
            else:
                rest -= page[COUNT]
            if at > end or not 0 <= page[PACKED] <= end - at:
                return -1
            if not 0 <= page[SIZE] <= _SWOLLEN * page[PACKED] + _SWOLLEN or page[COUNT] < 0:
                return -1
            at += page[PACKED]
            total += 1
            first = False
    return total


@helper
def _bits(room: Any, at: Any, stop: Any, width: Any, out: Any) -> bool:
    """Numbers of so many bits each, in runs of equal ones and packed by eight, into (n,) int64."""
    done = 0
    bytes_each = (width + 7) // 8
    while done < len(out):
        head, at = _varint(room, at)
        if at < 0 or head < 2:
            return False
        count = head >> 1
        if head & 1:
            if count > len(out) or at + count * width > stop:
                return False
            held, bits, place = np.uint64(0), np.int64(0), at
            mask = (np.uint64(1) << np.uint64(width)) - np.uint64(1)
            for _ in range(min(8 * count, len(out) - done)):
                while bits < width:
                    held |= np.uint64(room[place]) << np.uint64(bits)
                    place += 1
                    bits += 8
                out[done] = np.int64(held & mask)
                done += 1
                held >>= np.uint64(width)
                bits -= width
            at += count * width
            continue
        if count > len(out) - done or at + bytes_each > stop:
            return False
        value: Any = np.int64(0)
        for i in range(bytes_each):
            value |= np.int64(room[at + i]) << 8 * i
        at += bytes_each
        out[done : done + count] = value
        done += count
    return True


@helper
def _levels(room: Any, at: Any, width: Any, out: Any) -> Any:
    """Levels with their length before them; where they end, -1 for what is none."""
    if at + 4 > len(room):
        return -1
    size = np.int64(0)
    for i in range(4):
        size |= np.int64(room[at + i]) << 8 * i
    stop = at + 4 + size
    if stop > len(room) or not _bits(room, at + 4, stop, width, out):
        return -1
    return stop


@kernel
def read_values(
    room: Any, pages: Any, deepest: Any, repeated: Any, starts: Any,
    depths: Any, again: Any, values: Any, ends: Any,
) -> bool:  # fmt: skip
    """The values of pages, those of each column together.

    Args:
        room: (N,) uint8, the pages' bytes once they are unpacked, one after the other.
        pages: (P, 7) from ``find_all_pages``.
        deepest: (C,) how deep a value that is there lies, 0 to 3.
        repeated: (C,) whether the column holds lists.
        starts: (C,) where each column begins in what is filled.
        depths: (V,) int64 to be filled: how deep each value lies, less where it is missing.
        again: (V,) int64 likewise: 1 for a value of the list that the one before is in.
        values: (V, 1) uint64 likewise: the bits of the values that are there, close together.
        ends: (C,) where those of each column end.

    Returns:
        False for what is not as it should be; nothing that was filled means anything then.
    """
    begin, column = 0, -1
    known: Any = np.int64(0)
    seen: Any = np.int64(0)
    for p in range(len(pages)):
        page = pages[p]
        if page[COLUMN] != column:
            column, seen = page[COLUMN], starts[page[COLUMN]]
            known, ends[column] = np.int64(-1), seen
        data = room[begin : begin + page[SIZE]]
        begin += page[SIZE]
        count, encoding = page[COUNT], page[ENCODING]
        if encoding == PLAIN - 1:
            known = count
            continue
        at, there = np.int64(0), count
        if repeated[column]:
            at = _levels(data, at, 1, again[seen : seen + count])
            if at < 0:
                return False
        if deepest[column] > 0:
            depth = depths[seen : seen + count]
            at = _levels(data, at, 2 if deepest[column] > 1 else 1, depth)
            if at < 0:
                return False
            there = 0
            for i in range(count):
                there += depth[i] == deepest[column]
        first = ends[column]
        if not _fill(data, at, encoding, there, known, values, first):
            return False
        ends[column] = first + there
        seen += count
    return True


@helper
def _fill(
    data: Any, at: Any, encoding: Any, count: Any, known: Any, values: Any, first: Any
) -> bool:
    """So many values of one page."""
    if encoding == NAMES:
        if at >= len(data):
            return bool(count == 0 and at == len(data))
        width = np.int64(data[at])
        places = values[first : first + count, 0].view(np.int64)
        if width > 32 or not _bits(data, at + 1, len(data), width, places):
            return False
        strange = 0
        for i in range(count):
            strange += places[i] >= known
        return bool(strange == 0)
    if encoding == PLAIN:
        if at + (count + 7) // 8 != len(data):
            return False
        for i in range(count):
            values[first + i, 0] = np.uint64(data[at + i // 8] >> (i % 8) & 1)
        return True
    if count == 0:
        return True
    if encoding == SPLIT:
        return bool(_split_long(data, at, values[first : first + count, 0]))
    if encoding == DELTA:
        return bool(_deltas(data, at, values[first : first + count, 0]))
    return False
