"""Values of Parquet's data pages, in the encodings that this project's files are written with.

After the specification of the Parquet format (Encodings.md). Whatever is met beyond that is told
apart, and left to others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval._process.compiled import helper, kernel

from .parquet_footer import (
    CODEC,
    COMPRESSED,
    DICTIONARY,
    FIRST_PAGE,
    INT32,
    TYPE,
    VALUES,
)
from .thrift import MORE, _signed, _varint, fields

BEGIN, PACKED, SIZE, COUNT, ENCODING, CHECKSUM, COLUMN = range(7)
"""Of a page: where its bytes begin and how many they are, how many once they are unpacked, how many
values, how these are encoded, the checksum (-1 without one), and which column it belongs to."""

PLACE, KIND, OPTIONAL, BEFORE, WITHIN, WIDTH, NUMBER = range(7)
"""Of a column that is wanted: its place in the file, physical type, whether values may be missing, how
many columns come before its block, its number within, how many columns the block has, and which
block it is."""

LZ4 = 7
_RLE = 3
DELTA, SPLIT = 5, 9
_DATA_PAGE, _DICTIONARY_PAGE = 5 * MORE, 7 * MORE
_MOST, _WITH = 16, 1 << 16
"""Bytes per value that a page may unpack to, and bytes besides: no encoding here needs more."""
_ENDLESS = np.uint32(0x7F800000)
"""Bits that are all set where a float is infinite or no number."""
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
def locate(chunks: Any, plan: Any, rows: int, size: int, places: Any) -> Any:
    """Where columns are in the file.

    Args:
        chunks: (N, 6) of a row group, from ``Footer``.
        plan: (C, 7) from ``parquet_columns``.
        rows: of the group.
        size: of the file.
        places: (C, 2) to be filled: where each column begins and ends.

    Returns:
        Where the first begins, where the last ends, and how many bytes they are; -1 for columns
        that this project would not have written so.
    """
    begin, end, total = np.int64(size), np.int64(0), np.int64(0)
    for column in range(len(plan)):
        about = chunks[plan[column, PLACE]]
        first, packed = about[FIRST_PAGE], about[COMPRESSED]
        if about[TYPE] != plan[column, KIND] or about[VALUES] != rows or about[CODEC] != LZ4:
            return -1, 0, 0
        if about[DICTIONARY] >= 0 or not 0 < packed <= size or not 0 < first <= size - packed:
            return -1, 0, 0
        places[column, 0], places[column, 1] = first, first + packed
        begin, end, total = min(begin, first), max(end, first + packed), total + packed
    return begin, end, total


@kernel
def find_pages(
    data: Any, plan: Any, chunks: Any, rows: int, found: Any, stack: Any, pages: Any
) -> int:
    """The pages of some columns.

    Args:
        data: (N,) uint8.
        plan: (C, 7) as for ``locate``; floats are ``SPLIT``, whole numbers ``DELTA``.
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
        encoding = DELTA if plan[column, KIND] == INT32 else SPLIT
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
def _split(room: Any, at: Any, target: Any, spare: Any) -> bool:
    """Floats of which the file has all first bytes, then all second bytes, and so on."""
    count = len(target)
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
    for k in range(count):
        target[np.uintp(k)] = spare[np.uintp(k)]
    return True


@helper
def _split_long(room: Any, at: Any, target: Any) -> bool:
    """As ``_split``, of 8 bytes each."""
    count = len(target)
    if at + 8 * count != len(room):
        return False
    target[:] = 0
    for part in range(8):
        stored = room[at + part * count : at + (part + 1) * count]
        shift = np.uint64(8 * part)
        for k in range(count):
            i = np.uintp(k)
            target[i] |= np.uint64(stored[i]) << shift
    return True


@kernel
def _deltas(room: Any, at: Any, target: Any) -> bool:
    """Whole numbers as differences, in blocks of equal bit width above the block's least."""
    count = len(target)
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
    if target.itemsize == 8:
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


@helper
def _finite(values: Any) -> bool:
    """Whether floats, by their bits, are neither NaN nor infinite."""
    bad = 0
    for k in range(len(values)):
        bad |= (values[np.uintp(k)] & _ENDLESS) == _ENDLESS
    return bool(bad == 0)


@helper
def _counting(values: Any, first: Any) -> bool:
    """Whether they are ``first``, the next number, and so on."""
    wrong = 0
    for k in range(len(values)):
        wrong |= values[np.uintp(k)] != first + k
    return bool(wrong == 0)


@kernel
def read_pages(
    room: Any, pages: Any, plan: Any, rows: int, out: Any, spare: Any, sound: Any
) -> bool:
    """The values of pages, those of each column together, column beside column within a block.

    Args:
        room: (N,) uint8, the pages' bytes once they are unpacked, one after the other.
        pages: (P, 7) from ``find_pages``.
        plan: (C, 7) as for ``locate``.
        rows: how many values each column has.
        out: (rows · C,) uint32 or uint64 to be filled with the values' bits, block after block.
        spare: (rows,) uint32, room to work in.
        sound: (B,) all true, to be made false for a block with floats that are not finite, or whole
            numbers that do not count 0, 1, 2 and so on; of 64 bits they are not looked at.

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
        if plan[column, OPTIONAL]:
            at = _all_there(values, 0, count) if size >= 4 else -1
        if at < 0:
            return False
        step, number = plan[column, WIDTH], plan[column, NUMBER]
        start = plan[column, BEFORE] * rows + plan[column, WITHIN] + first * step
        target = out[start : start + (count - 1) * step + 1 : step]
        split = page[ENCODING] == SPLIT
        if out.itemsize == 8:
            good = _split_long(values, at, target) if split else _deltas(values, at, target)
            known = False
        elif split:
            good = _split(values, at, target, spare)
            known = _finite(spare[:count])
        else:
            good = _deltas(values, at, spare[:count])
            known = _counting(spare[:count], first)
            for k in range(count):
                target[np.uintp(k)] = spare[np.uintp(k)]
        if not good:
            return False
        sound[number] = sound[number] and known
        first += count
    return True


@kernel
def near_unit(turns: Any, tolerance: float) -> bool:
    """Whether the squares of quaternions' (T, 4) norms are as near to 1 as that."""
    far = 0
    for i in range(len(turns)):
        w, x = np.float64(turns[i, 0]), np.float64(turns[i, 1])
        y, z = np.float64(turns[i, 2]), np.float64(turns[i, 3])
        near = abs(w * w + x * x + y * y + z * z - 1.0) < tolerance  # no number is not near
        far += not near
    return far == 0
