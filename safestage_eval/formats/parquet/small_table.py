"""Rows of small Parquet tables: of names, numbers, truth values, and lists of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from lz4.block import LZ4BlockError, decompress  # type: ignore[import-untyped]
from numpy.typing import NDArray

from safestage_eval.formats.byte_source import Source
from safestage_eval.formats.checksum import crc32

from .parquet_footer import (
    CODEC,
    COMPRESSED,
    DICTIONARY,
    FIRST_PAGE,
    TYPE,
    VALUES,
    Footer,
    Leaf,
)

LZ4 = 7
"""How this project packs pages."""
BOOLEAN, INT32, INT64, DOUBLE, TEXT = 0, 1, 2, 5, 6
"""Physical types."""

PHYSICAL = {
    "bool": BOOLEAN, "int32": INT32, "int64": INT64, "double": DOUBLE, "string": TEXT,
    "dictionary": TEXT, "list<double>": DOUBLE,
}  # fmt: skip
"""Types of columns as ``arrow_tables`` names them."""

MOST = 1 << 18
"""Values that are read here; tables with more are better read by pyarrow."""

_FLAT, _LIST = ((0,), (1,)), ((0, 2, 0), (0, 2, 1), (1, 2, 0), (1, 2, 1))
"""How often the elements of a column occur (1: perhaps, 2: repeated), from the row inwards."""


class _Column(NamedTuple):
    """One column of a row group: what it holds and where.

    Attributes:
        leaf: of the column.
        kind: its physical type.
        begin, end: place of its bytes.
        values: how many it has, missing ones included.
    """

    leaf: Leaf
    kind: int
    begin: int
    end: int
    values: int


class _Read(NamedTuple):
    """Rows that were read, and all that they depend on.

    Attributes:
        data: the bytes of their columns.
        columns: those, by where they are in ``data``.
        names: of the columns.
        rows: how many there must be.
        records: the rows.
    """

    data: bytes
    columns: list[_Column]
    names: tuple[str, ...]
    rows: int
    records: list[dict[str, Any]]


_READ: list[_Read] = []
"""Those of the last few scenes: a task's episodes mostly have the same shapes, byte for byte."""
_READ_KEPT = 8


def read_records(
    file: Source, footer: Footer, group: int, kinds: Mapping[str, str], *, again: bool = False
) -> list[dict[str, Any]] | None:
    """The rows of a row group as pyarrow tells them, in a third of the time.

    pyarrow makes a new decoder for every column, which for tables of a few rows is all the work.
    Anything unusual or damaged is left to pyarrow, which finds words for it.

    Args:
        file: the open file.
        footer: of the file.
        group: number of the row group.
        kinds: column → its type as ``arrow_tables`` names it.
        again: other groups are likely to hold the same. Where they do, byte for byte, the very same
            rows are given back, which must not be changed.

    Returns:
        None where only pyarrow can tell.
    """
    columns = _columns(footer, group, kinds)
    if not columns or sum(column.values for column in columns) > MOST:
        return None
    begin, end = min(c.begin for c in columns), max(c.end for c in columns)
    if end > file.size:
        return None
    data = file.read(begin, end - begin)
    if len(data) != end - begin:
        return None
    rows, names = footer.groups.rows(group), tuple(kinds)
    columns = [c._replace(begin=c.begin - begin, end=c.end - begin) for c in columns]
    for known in _READ if again else ():
        if known.data == data and known[1:4] == (columns, names, rows):
            return known.records
    cells = _decoded(data, columns, rows)
    if cells is None:
        return None
    records = [dict(zip(kinds, row, strict=True)) for row in zip(*cells, strict=True)]
    if again:
        _READ[:] = [_Read(data, columns, names, rows, records), *_READ[: _READ_KEPT - 1]]
    return records


def _columns(footer: Footer, group: int, kinds: Mapping[str, str]) -> list[_Column] | None:
    """Where the columns are; None if one is missing, or not as this project writes it."""
    if footer.chunks is None:
        return None
    chunks, found = footer.chunks[group].tolist(), []
    rows = footer.groups.rows(group)
    for name, kind in kinds.items():
        leaf = (footer.lists if kind.startswith("list") else footer.leaves).get(name)
        if leaf is None or leaf.levels not in (_LIST if kind.startswith("list") else _FLAT):
            return None
        about = chunks[leaf.place]
        first, dictionary = about[FIRST_PAGE], about[DICTIONARY]
        begin = dictionary if dictionary > 0 else first
        usual = about[TYPE] == PHYSICAL[kind] and about[CODEC] == LZ4 and about[VALUES] >= rows
        if not usual or not (leaf.text if about[TYPE] == TEXT else leaf.number):
            return None
        if not 0 < begin <= first or about[COMPRESSED] <= 0:
            return None
        found.append(_Column(leaf, about[TYPE], begin, begin + about[COMPRESSED], about[VALUES]))
    return found


def _decoded(data: bytes, columns: list[_Column], rows: int) -> list[list[Any]] | None:
    """The cells of each column, whose places are those in ``data``."""
    from .record_kernels import find_all_pages, read_values

    chunks = np.array([(c.begin, c.end, c.values) for c in columns])
    found, stack = np.empty((64, 3), np.int64), np.empty((16, 4), np.int64)
    pages = np.empty((3 * len(columns) + MOST // 1000, 7), np.int64)
    count = find_all_pages(np.frombuffer(data, np.uint8), chunks, found, stack, pages)
    unpacked = _unpacked(data, pages[:count]) if count > 0 else None
    if unpacked is None:
        return None
    pages, total = pages[:count], int(chunks[:, 2].sum())
    starts = np.cumsum(chunks[:, 2]) - chunks[:, 2]
    depths, again = np.zeros(total, np.int64), np.zeros(total, np.int64)
    values, ends = np.zeros((total, 1), np.uint64), starts.copy()
    deepest = np.array([sum(level > 0 for level in c.leaf.levels) for c in columns])
    lists = np.array([len(column.leaf.levels) > 1 for column in columns])
    room = np.frombuffer(b"".join(unpacked) or b"\0", np.uint8)
    if not read_values(room, pages, deepest, lists, starts, depths, again, values, ends):
        return None
    names: list[list[str]] = [[] for _ in columns]
    for page, text in zip(pages.tolist(), unpacked, strict=True):
        if page[4] < 0:
            words = _words(text, page[3])
            if words is None:
                return None
            names[page[6]] = words
    cells: list[list[Any]] = []
    for i, (column, start, end) in enumerate(
        zip(columns, starts.tolist(), ends.tolist(), strict=True)
    ):
        told = _told(column.kind, values[start:end, 0], names[i])
        place = slice(start, start + column.values)
        nested = _nested(column.leaf.levels, depths[place], again[place], told)
        if nested is None or len(nested) != rows:
            return None
        cells.append(nested)
    return cells


def _unpacked(data: bytes, pages: NDArray[np.int64]) -> list[bytes] | None:
    """The bytes of each page; None if one is damaged."""
    view = memoryview(data)
    found: list[bytes] = []
    for at, packed, size, _, _, checksum, _ in pages.tolist():
        page = view[at : at + packed]
        if checksum >= 0 and crc32(page) != checksum:
            return None
        try:
            found.append(decompress(page, uncompressed_size=size) if size else b"")
        except (LZ4BlockError, ValueError, OverflowError):
            return None
        if len(found[-1]) != size:
            return None
    return found


def _words(text: bytes, count: int) -> list[str] | None:
    """The words of a dictionary, each with its length before it."""
    found: list[str] = []
    at = 0
    try:
        while len(found) < count:
            size = int.from_bytes(text[at : at + 4], "little")
            at += 4 + size
            if at > len(text):
                return None
            found.append(text[at - size : at].decode())
    except UnicodeDecodeError:
        return None
    return found if at == len(text) else None


def _told(kind: int, bits: NDArray[np.uint64], names: list[str]) -> list[Any]:
    """Values of a physical type from their bits."""
    found: list[Any] = []
    if kind == TEXT:
        found = [names[i] for i in bits.tolist()]
    elif kind == DOUBLE:
        found = bits.view(np.float64).tolist()
    elif kind == BOOLEAN:
        found = bits.astype(np.bool_).tolist()
    elif kind == INT32:
        found = bits.astype(np.uint32).view(np.int32).tolist()
    else:
        found = bits.view(np.int64).tolist()
    return found


def _nested(
    levels: tuple[int, ...], depths: NDArray[np.int64], again: NDArray[np.int64], told: list[Any]
) -> list[Any] | None:
    """The cells of a column: values, lists of values, and None where nothing is."""
    if len(told) == len(depths):  # nothing is missing
        if len(levels) == 1:
            return told
        starts = np.flatnonzero(again == 0).tolist()
        if len(told) and starts[:1] != [0]:
            return None
        return [told[i:j] for i, j in pairwise([*starts, len(told)])]
    values = iter(told)
    deepest = sum(level > 0 for level in levels)
    if len(levels) == 1:
        if not told:
            return [None] * len(depths)
        return [next(values) if depth == deepest else None for depth in depths.tolist()]
    out: list[Any] = []
    empty = levels[0]  # as deep as a list lies that is there and has no values
    for depth, more in zip(depths.tolist(), again.tolist(), strict=True):
        if depth == deepest:
            if more and not (out and out[-1]):
                return None
            if not more:
                out.append([])
            out[-1].append(next(values))
        elif more or depth > empty:
            return None
        else:
            out.append([] if depth == empty else None)
    return out
