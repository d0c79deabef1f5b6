"""Columns of numbers of a Parquet file, straight into the arrays that are wanted."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from lz4.block import LZ4BlockError, decompress  # type: ignore[import-untyped]
from numpy.typing import NDArray

from safestage_eval.formats.byte_source import Source
from safestage_eval.formats.checksum import crc32

from .parquet_footer import Footer

KINDS = {np.dtype(np.int32): 1, np.dtype(np.float32): 4, np.dtype(np.float64): 5}
"""Physical types of the numbers that are read."""

INT32 = np.dtype(np.int32)
_BITS: dict[int, np.dtype[Any]] = {4: np.dtype(np.uint32), 8: np.dtype(np.uint64)}

_WASTE = 1 << 17
"""Bytes between columns that are rather read than skipped."""
_PLANS_KEPT = 1 << 10


class Block(NamedTuple):
    """Columns that become one array.

    Attributes:
        names: of the C columns.
        dtype: of the array; what is neither int32 nor a float is stored as int32.
    """

    names: tuple[str, ...]
    dtype: np.dtype[Any]


class Values(NamedTuple):
    """What a block holds.

    Attributes:
        array: (rows, C).
        sound: for sure, all floats are finite, and whole numbers count 0, 1, 2 and so on.
    """

    array: NDArray[Any]
    sound: bool


Plan = NDArray[np.int64]
"""(C, 7) how each column is read: see ``page_kernels.PLACE`` and the following."""


def read_blocks(
    file: Source, footer: Footer, group: int, blocks: tuple[Block, ...]
) -> list[Values] | None:
    """Columns of a row group; None where only pyarrow can read them.

    Several times as fast as pyarrow, which makes a new decoder for every column and then has the values
    copied once more. Anything unusual or damaged is left to pyarrow, which finds words for it.

    Args:
        file: the open file.
        footer: of the file.
        group: number of the row group.
        blocks: what is wanted, all of numbers of one size.
    """
    if footer.chunks is None:
        return None
    if blocks not in footer.plans:
        if len(footer.plans) >= _PLANS_KEPT:
            footer.plans.clear()
        footer.plans[blocks] = _planned(footer, blocks)
    plan, rows = footer.plans[blocks], footer.groups.rows(group)
    if plan is None or rows < 1:
        return None
    from .page_kernels import locate

    places = np.empty((len(plan), 2), np.int64)
    begin, end, packed = locate(footer.chunks[group], plan, rows, file.size, places)
    if begin < 0:
        return None
    if end - begin > packed + _WASTE:
        data = _gathered(file, places)
    else:
        data = file.read(begin, end - begin)
        places -= begin
        data = data if len(data) == end - begin else b""
    bits = np.empty(rows * len(plan), _BITS[_stored(blocks[0]).itemsize])
    sound = np.ones(len(blocks), np.bool_)
    if not (data and _decode(data, places, plan, rows, bits, sound)):
        return None
    found, first = [], 0
    for block, good in zip(blocks, sound.tolist(), strict=True):
        last = first + rows * len(block.names)
        array = bits[first:last].view(_stored(block)).reshape(rows, len(block.names))
        found.append(Values(array.astype(block.dtype, copy=False), good))
        first = last
    return found


def _stored(block: Block) -> np.dtype[Any]:
    """What the file holds."""
    return block.dtype if block.dtype in KINDS else INT32


def _planned(footer: Footer, blocks: tuple[Block, ...]) -> Plan | None:
    """None where one of the columns is missing or holds something else, or sizes differ."""
    if len({_stored(block).itemsize for block in blocks}) > 1:
        return None
    before, found = 0, []
    for number, block in enumerate(blocks):
        kind, width = KINDS[_stored(block)], len(block.names)
        for i, name in enumerate(block.names):
            leaf = footer.leaves.get(name)
            if leaf is None or not leaf.number:
                return None
            found.append((leaf.place, kind, leaf.optional, before, i, width, number))
        before += width
    return np.array(found, np.int64)


def _gathered(file: Source, places: NDArray[np.int64]) -> bytes:
    """Columns that lie far apart, of which ``places`` tells then where they are in what is given back."""
    order = places[:, 0].argsort()
    parts: list[bytes] = []
    start, total = 0, 0
    while start < len(order):
        stop, end = start + 1, int(places[order[start], 1])
        while stop < len(order) and places[order[stop], 0] <= end + _WASTE:
            end = max(end, int(places[order[stop], 1]))
            stop += 1
        begin = int(places[order[start], 0])
        parts.append(file.read(begin, end - begin))
        if len(parts[-1]) != end - begin:
            return b""
        places[order[start:stop]] += total - begin
        total += end - begin
        start = stop
    return b"".join(parts)


def _decode(
    data: bytes,
    places: NDArray[np.int64],
    plan: Plan,
    rows: int,
    bits: NDArray[np.unsignedinteger[Any]],
    sound: NDArray[np.bool_],
) -> bool:
    """The bytes of columns into their values' bits; false for what is unusual or damaged."""
    from .page_kernels import find_pages, read_pages

    # 20,000 values at most share a page as pyarrow writes them
    pages = np.empty((len(plan) * (1 + rows // 1000), 7), np.int64)
    found, stack = np.empty((64, 3), np.int64), np.empty((16, 4), np.int64)
    count = find_pages(np.frombuffer(data, np.uint8), plan, places, rows, found, stack, pages)
    if count < 1:
        return False
    pages = pages[:count]
    view, unpacked = memoryview(data), []
    try:
        for at, packed, size, _, _, checksum, _ in pages.tolist():
            page = view[at : at + packed]
            if checksum >= 0 and crc32(page) != checksum:
                return False
            unpacked.append(decompress(page, uncompressed_size=size))
            if len(unpacked[-1]) != size:
                return False
    except (LZ4BlockError, ValueError, OverflowError):
        return False
    room = np.frombuffer(unpacked[0] if count == 1 else b"".join(unpacked), np.uint8)
    return bool(read_pages(room, pages, plan, rows, bits, np.empty(rows, np.uint32), sound))
