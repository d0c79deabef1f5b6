"""Values of Parquet's data pages, in the encodings that this project's files are written with.

After the specification of the Parquet format (Encodings.md). Whatever is met beyond that is told
apart, and left to others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval.compiled import helper, kernel

from .thrift import MORE, _signed, _varint, fields

BEGIN, PACKED, SIZE, COUNT, ENCODING, CHECKSUM, COLUMN = range(7)
"""Of a page: where its bytes begin and how many they are, how many once they are unpacked, how many
values, how these are encoded, the checksum (-1 without one), and which column it belongs to."""

_RLE = 3
DELTA, SPLIT = 5, 9
_DATA_PAGE, _DICTIONARY_PAGE = 5 * MORE, 7 * MORE
_MOST, _WITH = 16, 1 << 16
"""Bytes per value that a page may unpack to, and bytes besides: no encoding here needs more."""
_BLOCK = 1 << 16
"""Longest block of differences; writers make blocks of 128."""


@helper
def told(found: Any, count: int, page: Any) -> tuple[int, int, int]:
    """What a page's header says, from its first ``count`` fields in ``found``.

    Fills ``page`` (7,) but for ``BEGIN`` and ``COLUMN``; -1 stands for what it does not say.

    Returns:
        The kind of page, how its levels are encoded, and how the names of a dictionary are.
    """
    page[:] = -1
    kind, levels, names = -1, -1, -1
    for i in range(count):
        path, value = found[i, 0], found[i, 1]
        if path == 1:
            kind = value
        elif path == 2:
            page[SIZE] = value
        elif path == 3:
            page[PACKED] = value
        elif path == 4:
            page[CHECKSUM] = value & 0xFFFFFFFF
        elif path == _DATA_PAGE + 1 or path == _DICTIONARY_PAGE + 1:
            page[COUNT] = value
        elif path == _DATA_PAGE + 2:
            page[ENCODING] = value
        elif path == _DATA_PAGE + 3:
            levels = value
        elif path == _DICTIONARY_PAGE + 2:
            names = value
    return kind, levels, names


@kernel
def find_pages(
    data: Any, encoding: Any, chunks: Any, rows: int, found: Any, stack: Any, pages: Any
) -> int:
    """The pages of some columns.

    Args:
        data: (N,) uint8.
        encoding: of the values, ``SPLIT`` or ``DELTA``.
        chunks: (C, 2) where each column's bytes begin and end.
        rows: how many values each column has.
        found: room for ``thrift.fields``.
        stack: likewise.
        pages: (P, 7) int64 to be filled, see ``BEGIN`` and the following.

    Returns:
        How many pages there are; -1 for pages of another kind, or that are not whole.
    """
    total = 0
    for column in range(len(chunks)):
        at, end, values = chunks[column, 0], chunks[column, 1], 0
        while values < rows:
            count, at = fields(data[:end], at, found, stack)
            if count < 0 or total >= len(pages):
                return -1
            page = pages[total]
            kind, levels, _ = told(found, count, page)
            page[BEGIN], page[COLUMN] = at, column
            if kind != 0 or levels != _RLE or page[ENCODING] != encoding:
                return -1
            if at > end or not 0 <= page[PACKED] <= end - at:
                return -1
            if not 0 < page[COUNT] <= rows - values:
                return -1
            if not 0 <= page[SIZE] <= _MOST * page[COUNT] + _WITH:
                return -1
            at += page[PACKED]
            values += page[COUNT]
            total += 1
        if values != rows:
            return -1
    return total


@helper
def _all_there(room: Any, begin: Any, count: Any) -> Any:
    """Where the values start after their definition levels, of which none may be 0; else -1."""
    size = np.int64(0)
    for i in range(4):
        size |= np.int64(room[begin + i]) << 8 * i
    at = begin + 4
    stop = at + size
    if size < 0 or stop > len(room):
        return -1
    seen = 0
    while at < stop and seen < count:
        run, at = _varint(room, at)
        if at < 0 or at >= stop or run & 1 or room[at] != 1:
            return -1
        if not 0 < run >> 1 <= count - seen:
            return -1
        seen += run >> 1
        at += 1
    return stop if seen == count else -1


@helper
def _split(room: Any, at: Any, count: Any, out: Any, first: Any, column: Any, spare: Any) -> bool:
    """Floats of which the file has all first bytes, then all second bytes, and so on."""
    if at + 4 * count != len(room):
        return False
    low = room[at : at + count]
    second = room[at + count : at + 2 * count]
    third = room[at + 2 * count : at + 3 * count]
    high = room[at + 3 * count : at + 4 * count]
    # side by side first: many at once, which is not done for values that lie apart
    for k in range(count):
        i = np.uintp(k)  # an index without sign need not be looked at
        spare[i] = (
            np.uint32(low[i])
            | np.uint32(second[i]) << np.uint32(8)
            | np.uint32(third[i]) << np.uint32(16)
            | np.uint32(high[i]) << np.uint32(24)
        )
    target = out[first : first + count, column]
    for k in range(count):
        target[np.uintp(k)] = spare[np.uintp(k)]
    return True


@helper
def _split_long(room: Any, at: Any, count: Any, out: Any, first: Any, column: Any) -> bool:
    """As ``_split``, of 8 bytes each."""
    if at + 8 * count != len(room):
        return False
    target = out[first : first + count, column]
    target[:] = 0
    for part in range(8):
        stored = room[at + part * count : at + (part + 1) * count]
        shift = np.uint64(8 * part)
        for k in range(count):
            i = np.uintp(k)
            target[i] |= np.uint64(stored[i]) << shift
    return True


@kernel
def _deltas(room: Any, at: Any, count: Any, out: Any, first: Any, column: Any) -> bool:
    """Whole numbers as differences, in blocks of equal bit width above the block's least."""
    block, at = _varint(room, at)
    parts, at = _varint(room, at) if at >= 0 else (block, at)
    total, at = _varint(room, at) if at >= 0 else (block, at)
    value, at = _varint(room, at) if at >= 0 else (block, at)
    if at < 0 or not 0 < block <= _BLOCK or not 0 < parts <= block or total != count:
        return False
    if block % (32 * parts):
        return False
    value = _signed(value)
    size = block // parts
    target = out[first : first + count, column]
    if out.itemsize == 8:
        target[0] = np.uint64(value)
    else:
        target[0] = np.uint32(value & 0xFFFFFFFF)
    done = 1
    while done < count:
        least, at = _varint(room, at)
        if at < 0 or at + parts > len(room):
            return False
        least = _signed(least)
        widths = at
        at += parts
        for part in range(parts):
            if done >= count:
                break
            width = np.int64(room[widths + part])
            if width > 32 or at + size * width // 8 > len(room):
                return False
            value = _part(room[at:], width, least, value, target[done : min(done + size, count)])
            done += size
            at += size * width // 8
    return True


@helper
def _part(room: Any, width: Any, least: Any, value: Any, target: Any) -> Any:
    """Differences of one bit width into ``target``; the last value."""
    held, bits = np.uint64(0), np.int64(0)
    mask = (np.uint64(1) << np.uint64(width)) - np.uint64(1)
    at = np.uintp(0)
    if width == 0:  # they rise evenly, as the numbers of frames do
        for k in range(len(target)):
            each = value + least * (k + 1)
            if target.itemsize == 8:
                target[np.uintp(k)] = np.uint64(each)
            else:
                target[np.uintp(k)] = np.uint32(each & 0xFFFFFFFF)
        return value + least * len(target)
    for k in range(len(target)):
        while bits < width:
            held |= np.uint64(room[at]) << np.uint64(bits)
            at += np.uintp(1)
            bits += 8
        value += least + np.int64(held & mask)
        held >>= np.uint64(width)
        bits -= width
        if target.itemsize == 8:
            target[np.uintp(k)] = np.uint64(value)
        else:
            target[np.uintp(k)] = np.uint32(value & 0xFFFFFFFF)
    return value


@kernel
def read_pages(room: Any, pages: Any, optional: Any, out: Any, spare: Any) -> bool:
    """The values of pages, each column's into a column of its own.

    Args:
        room: (N,) uint8, the pages' bytes once they are unpacked, one after the other.
        pages: (P, 7) from ``find_pages``.
        optional: (C,) whether values of a column may be missing.
        out: (rows, C) uint32 or uint64 to be filled with the values' bits.
        spare: (rows,) uint32, room to work in.

    Returns:
        False for what is not as it should be; ``out`` means nothing then.
    """
    column, first, begin = -1, 0, 0
    for p in range(len(pages)):
        page = pages[p]
        if page[COLUMN] != column:
            column, first = page[COLUMN], 0
        size, count = page[SIZE], page[COUNT]
        values = room[begin : begin + size]
        begin += size
        at = 0
        if optional[column]:
            at = _all_there(values, 0, count) if size >= 4 else -1
        if at < 0:
            return False
        if page[ENCODING] == SPLIT and out.itemsize == 8:
            good = _split_long(values, at, count, out, first, column)
        elif page[ENCODING] == SPLIT:
            good = _split(values, at, count, out, first, column, spare)
        else:
            good = _deltas(values, at, count, out, first, column)
        if not good:
            return False
        first += count
    return True
