"""Columns of numbers of a Parquet file, straight into the array that is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from lz4.block import LZ4BlockError, decompress  # type: ignore[import-untyped]
from numpy.typing import NDArray

from .checksum import crc32
from .parquet_footer import CODEC, COMPRESSED, DICTIONARY, FIRST_PAGE, TYPE, VALUES, Footer
from .source import Source

KINDS = {np.dtype(np.int32): 1, np.dtype(np.float32): 4, np.dtype(np.float64): 5}
"""Physical types of the numbers that are read."""

_BITS: dict[int, np.dtype[Any]] = {4: np.dtype(np.uint32), 8: np.dtype(np.uint64)}

LZ4 = 7
_WASTE = 1 << 16
"""Bytes between columns that are rather read than skipped."""


def read_columns(
    file: Source, footer: Footer, group: int, names: Sequence[str], out: NDArray[np.generic]
) -> bool:
    """Columns of a row group into the columns of ``out``; false where only pyarrow can do so.

    Up to 1.8 times as fast as pyarrow, which makes a new decoder for every column and then has the values
    copied once more. Anything unusual or damaged is left to pyarrow, which finds words for it.

    Args:
        file: the open file.
        footer: of the file.
        group: number of the row group.
        names: of the columns.
        out: (rows, C) float32, float64 or int32, to be filled.
    """
    if footer.chunks is None:
        return False
    leaves = [footer.leaves.get(name) for name in names]
    rows, kind = len(out), KINDS[out.dtype]
    told, optional, begin, end, wanted = [], [], file.size, 0, 0
    for leaf in leaves:
        if leaf is None or not leaf.number:
            return False
        about = footer.chunks[group, leaf.place].tolist()
        first, packed = about[FIRST_PAGE], about[COMPRESSED]
        usual = about[TYPE] == kind and about[VALUES] == rows and about[DICTIONARY] < 0
        if not (usual and about[CODEC] == LZ4 and first > 0 and packed > 0):
            return False
        told.append((first, first + packed))
        optional.append(leaf.optional)
        begin, end, wanted = min(begin, first), max(end, first + packed), wanted + packed
    if end > file.size:
        return False
    if end - begin > wanted + _WASTE:
        return _one_by_one(file, footer, group, names, out)
    data = file.read(begin, end - begin)
    return len(data) == end - begin and _decode(
        data, np.array(told) - begin, np.array(optional), out
    )


def _decode(
    data: bytes, chunks: NDArray[np.int64], optional: NDArray[np.bool_], out: NDArray[np.generic]
) -> bool:
    """The bytes of columns into the columns of ``out``."""
    from .page_kernels import DELTA, SPLIT, find_pages, read_pages

    rows, columns = out.shape
    found, stack = np.empty((64, 3), np.int64), np.empty((16, 4), np.int64)
    # 20,000 values at most share a page as pyarrow writes them
    pages = np.empty((columns * (1 + rows // 1000), 7), np.int64)
    encoding = SPLIT if out.dtype.kind == "f" else DELTA
    values = np.frombuffer(data, np.uint8)
    count = find_pages(values, encoding, chunks, rows, found, stack, pages)
    if count < 0:
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
    bits, spare = out.view(_BITS[out.itemsize]), np.empty(rows, np.uint32)
    return bool(read_pages(room, pages, optional, bits, spare))


def _one_by_one(
    file: Source, footer: Footer, group: int, names: Sequence[str], out: NDArray[np.generic]
) -> bool:
    for i, name in enumerate(names):
        column = np.empty((len(out), 1), out.dtype)
        if not read_columns(file, footer, group, [name], column):
            return False
        out[:, i] = column[:, 0]
    return True
