"""What the end of a Parquet file says: its row groups, and where their columns are.

Field numbers are those of ``parquet.thrift`` in the Parquet format specification.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .footer_types import types_agree
from .source import Source

KEYS: dict[str, type] = {"episode_index": int, "body": str, "body1": str, "body2": str}
"""Columns that rows are looked up by, and what they hold."""

# fields of a column's metadata
CODEC, VALUES, COMPRESSED, FIRST_PAGE, DICTIONARY = 4, 5, 7, 9, 11
TYPE = 1
_END = 1 << 16
"""Bytes at the end of a file that are read at once: nearly every footer is in them."""

INT32, INT64, BYTES = 1, 2, 6
"""Physical types of keys."""
_OPTIONAL = 1

# fields of an element of the schema
_SAID = slice(3, 7)
"""Its repetition, name, number of elements inside, and meaning."""
_TEXT, _LIST = 0, 3
_WHOLE_NUMBERS = range(11, 19)
"""UINT_8 to INT_64."""


_SCHEMAS: dict[
    tuple[bytes, bytes],
    tuple[dict[str, Leaf], dict[str, Leaf], frozenset[str], int],
] = {}
"""Columns by what tells of them: the numbers of the schema's elements, and the bytes with their names."""
_SCHEMAS_KEPT = 64


class Group(NamedTuple):
    """A row group: its number, its rows, and the least and greatest of each key that it states."""

    number: int
    rows: int
    limits: dict[str, tuple[Any, Any]]

    def single(self, key: str) -> Any:
        """The only value of a key; None where there are several, or the file does not say."""
        least, greatest = self.limits.get(key, (None, None))
        return least if least == greatest else None

    def may_hold(self, **keys: Any) -> bool:
        """Rows with these values may be in it; None stands for any value."""
        for key, value in keys.items():
            if value is not None and key in self.limits:
                least, greatest = self.limits[key]
                if not least <= value <= greatest:
                    return False
        return True

    def only(self, **keys: Any) -> bool:
        """All of its rows have these values; None stands for any value."""
        return all(value is None or self.single(key) == value for key, value in keys.items())


class Leaf(NamedTuple):
    """A column of values, or of lists of them.

    Attributes:
        place: among the columns that hold values.
        levels: how often the elements around a value, and it itself, occur: 0 once, 1 perhaps,
            2 any number of times.
        number: it is of numbers, as far as it says: no dates, no decimals.
        text: it is of text.
    """

    place: int
    levels: tuple[int, ...]
    number: bool
    text: bool = False

    @property
    def optional(self) -> bool:
        """Values may be missing."""
        return self.levels[-1] == _OPTIONAL


class Footer(NamedTuple):
    """Row groups and columns of a file.

    Attributes:
        groups: in the file's order.
        columns: names, of lists and records too.
        leaves: name → where the column is; without those in lists and records.
        lists: likewise, of those in lists.
        chunks: (groups, columns, 16) int64, fields of each column's metadata by number; None where
            only pyarrow can tell.
    """

    groups: tuple[Group, ...]
    columns: frozenset[str]
    leaves: Mapping[str, Leaf]
    chunks: NDArray[np.int64] | None
    lists: Mapping[str, Leaf] = MappingProxyType({})


def by_pyarrow(metadata: pq.FileMetaData, file: Source) -> Footer:
    """Read by pyarrow, whatever the file; raises UnicodeDecodeError for names that are no text.

    Asked for a column whose type the footer states in two ways, pyarrow ends the process: such a
    file is read ``without_keys``.
    """
    if not types_agree(_bytes(file)):
        return without_keys(metadata)
    columns = frozenset(metadata.schema.to_arrow_schema().names)
    names = [metadata.schema.column(i).path for i in range(metadata.num_columns)]
    keys = {key: names.index(key) for key in KEYS if key in names}
    found = []
    for i in range(metadata.num_row_groups):
        group, limits = metadata.row_group(i), {}
        for key, place in keys.items():
            told = group.column(place).statistics
            if told is not None and told.has_min_max and not told.null_count:
                both = told.min, told.max
                if all(isinstance(limit, KEYS[key]) for limit in both):
                    limits[key] = both
        found.append(Group(i, group.num_rows, limits))
    return Footer(tuple(found), columns, {}, None)


def without_keys(metadata: pq.FileMetaData) -> Footer:
    """Of which any group may hold any key; all rows are said to be in the first one."""
    groups = (Group(i, 0 if i else metadata.num_rows, {}) for i in range(metadata.num_row_groups))
    columns = frozenset(metadata.schema.to_arrow_schema().names)
    return Footer(tuple(groups), columns, {}, None)


def read_footer(file: Source) -> Footer | None:
    """Read from an open file; None if it is not as expected.

    Likewise where the compiler of kernels has not been loaded, which takes much longer and 50 MB:
    whoever measures shapes has it loaded.
    """
    if "numba" not in sys.modules:
        return None
    data = _bytes(file)
    return parse(data) if data else None


def _bytes(file: Source) -> bytes:
    """Of the footer; none if the file is not as expected."""
    size = file.size
    tail = min(size, _END)
    end = file.read(size - tail, tail)
    length = int.from_bytes(end[-8:-4], "little") + 8
    if tail < length <= size:
        end = file.read(size - length, length)
    if end[-4:] != b"PAR1" or not 8 < length <= len(end):
        return b""
    return end[-length:-8]


def parse(data: bytes) -> Footer | None:
    """Read from the bytes of a footer, in less than half of the time; None if it is not as expected."""
    from .footer_kernels import tables

    told = tables(np.frombuffer(data, np.uint8))
    if told is None:
        return None
    schema, rows, chunks, statistics = told
    try:
        leaves, lists, columns, places = _known_schema(data, schema[:, _SAID])
        chunks = chunks.reshape(len(rows), places, -1)
        limits = _limits(data, leaves, chunks, statistics.reshape(len(rows), places, -1, 2))
        if rows.min(initial=0) < 0:
            return None
    except (IndexError, ValueError):  # UnicodeDecodeError is a ValueError
        return None
    groups = tuple(map(Group, range(len(rows)), rows.tolist(), limits))
    return Footer(groups, columns, leaves, chunks, lists)


def _known_schema(
    data: bytes, elements: NDArray[np.int64]
) -> tuple[dict[str, Leaf], dict[str, Leaf], frozenset[str], int]:
    """As ``_schema``, worked out once for all files of a kind: theirs begin with the same bytes."""
    names = elements[:, 1]
    key = data[: max(int(names.sum(axis=1).max()), 0)], elements.tobytes()
    if key not in _SCHEMAS:
        if len(_SCHEMAS) >= _SCHEMAS_KEPT:
            _SCHEMAS.clear()
        _SCHEMAS[key] = _schema(data, elements.tolist())
    return _SCHEMAS[key]


def _schema(
    data: bytes, elements: list[list[list[int]]]
) -> tuple[dict[str, Leaf], dict[str, Leaf], frozenset[str], int]:
    """Columns of plain values, those of lists, all names, and how many columns of values there are."""
    leaves: dict[str, Leaf] = {}
    lists: dict[str, Leaf] = {}
    names, place = [], 0
    todo = [elements[0][2][0]]  # elements that are left on each level
    around: list[tuple[str, int, int, int]] = []  # of each: name, repetition, meaning, elements
    for (repetition, _), (at, size), (inside, _), (meaning, _) in elements[1:]:
        while todo[-1] == 0:
            todo.pop()
            around.pop()
        todo[-1] -= 1
        name, top = data[at : at + size].decode(), len(todo) == 1
        if top:
            names.append(name)
        if inside > 0:
            todo.append(inside)
            around.append((name, repetition, meaning, inside))
            continue
        number, text = meaning == -1 or meaning in _WHOLE_NUMBERS, meaning == _TEXT
        if top and 0 <= repetition <= _OPTIONAL:
            leaves[name] = Leaf(place, (repetition,), number, text)
        elif [about[2:] for about in around] == [(_LIST, 1), (-1, 1)] and around[1][0] == "list":
            levels = around[0][1], around[1][1], repetition
            lists[around[0][0]] = Leaf(place, levels, number, text)
        place += 1
    if len(set(names)) < len(names):
        raise ValueError
    return leaves, lists, frozenset(names), place


def _limits(
    data: bytes,
    leaves: Mapping[str, Leaf],
    chunks: NDArray[np.int64],
    statistics: NDArray[np.int64],
) -> list[dict[str, tuple[Any, Any]]]:
    """Of each group the least and greatest value of the keys, where they are exact."""
    found: list[dict[str, tuple[Any, Any]]] = [{} for _ in chunks]
    for key, meant in KEYS.items():
        if key not in leaves:
            continue
        place = leaves[key].place
        (missing, _, greatest, least, *exact), (_, _, greatest_size, least_size, *_) = statistics[
            :, place
        ].T.tolist()
        kinds = chunks[:, place, TYPE].tolist()
        for i, kind in enumerate(kinds):
            if kind not in ((BYTES,) if meant is str else (INT32, INT64)):
                continue
            if greatest[i] < 0 or least[i] < 0:
                continue
            if missing[i] > 0 or exact[0][i] == 0 or exact[1][i] == 0:
                continue
            low = data[least[i] : least[i] + least_size[i]]
            high = data[greatest[i] : greatest[i] + greatest_size[i]]
            if kind == BYTES:
                found[i][key] = low.decode(), high.decode()
            else:
                found[i][key] = _whole(low), _whole(high)
    return found


def _whole(text: bytes) -> int:
    return int.from_bytes(text, "little", signed=True)
