"""What the end of a Parquet file says: its row groups, and where their columns are.

Field numbers are those of ``parquet.thrift`` in the Parquet format specification.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval.formats.byte_source import Source

from .footer_types import types_agree
from .row_groups import KEYS, RowGroups

TYPE, CODEC, VALUES, COMPRESSED, FIRST_PAGE, DICTIONARY = range(6)
"""What ``Footer.chunks`` tells of a column in a row group."""
_END = 1 << 16
"""Bytes at the end of a file that are read at once: nearly every footer is in them."""

INT32, INT64, BYTES = 1, 2, 6
"""Physical types of keys."""
_OPTIONAL = 1

_TEXT, _LIST = 0, 3
_WHOLE_NUMBERS = range(11, 19)
"""UINT_8 to INT_64."""


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


class Schema(NamedTuple):
    """The columns of a file.

    Attributes:
        leaves: name → where the column is; without those in lists and records.
        lists: likewise, of those in lists.
        names: of all, of lists and records too.
        places: how many columns of values there are.
        plans: see ``Footer``.
    """

    leaves: Mapping[str, Leaf]
    lists: Mapping[str, Leaf]
    names: frozenset[str]
    places: int
    plans: dict[Any, Any]


_SCHEMAS: dict[tuple[bytes, bytes], Schema] = {}
"""By what tells of them: the numbers of the schema's elements, and the bytes with their names."""
_SCHEMAS_KEPT = 64


class Footer(NamedTuple):
    """Row groups and columns of a file.

    Attributes:
        groups: in the file's order.
        columns: names, of lists and records too.
        leaves: name → where the column is; without those in lists and records.
        lists: likewise, of those in lists.
        plans: whoever reads columns keeps here how; of all files of a kind.
        chunks: (groups, columns, 6) int64, ``TYPE`` to ``DICTIONARY`` of each column; None where
            only pyarrow can tell.
    """

    groups: RowGroups
    columns: frozenset[str]
    leaves: Mapping[str, Leaf]
    chunks: NDArray[np.int64] | None
    lists: Mapping[str, Leaf]
    plans: dict[Any, Any]


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
    rows: list[int] = []
    limits: dict[str, tuple[list[Any], list[Any]]] = {key: ([], []) for key in keys}
    for i in range(metadata.num_row_groups):
        group = metadata.row_group(i)
        rows.append(group.num_rows)
        for key, place in keys.items():
            told, both = group.column(place).statistics, (None, None)
            if told is not None and told.has_min_max and not told.null_count:
                both = told.min, told.max
            if not all(isinstance(limit, KEYS[key]) for limit in both):
                both = None, None
            for limit, found in zip(both, limits[key], strict=True):
                found.append(limit)
    return Footer(RowGroups(rows, limits), columns, {}, None, {}, {})


def without_keys(metadata: pq.FileMetaData) -> Footer:
    """Of which any group may hold any key; all rows are said to be in the first one."""
    rows = [0 if i else metadata.num_rows for i in range(metadata.num_row_groups)]
    columns = frozenset(metadata.schema.to_arrow_schema().names)
    return Footer(RowGroups(rows, {}), columns, {}, None, {}, {})


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
    if len(end) < tail or end[-4:] != b"PAR1" or not 8 < length <= size:
        return b""
    if length <= tail:
        return end[-length:-8]
    found = file.read(size - length, length - 8)
    return found if len(found) == length - 8 else b""


def parse(data: bytes) -> Footer | None:
    """Read from the bytes of a footer, in a tenth of the time; None if it is not as expected."""
    from .footer_kernels import beginning, sorted_out

    octets = np.frombuffer(data, np.uint8)
    begin = beginning(octets)
    if begin is None:
        return None
    try:
        schema = _known_schema(data, begin.elements)
        keys = {key: leaf.place for key in KEYS if (leaf := schema.leaves.get(key)) is not None}
        told = sorted_out(octets, begin, schema.places, np.array(list(keys.values()), np.int64))
        if told is None:
            return None
        rows, chunks, statistics = told
        if rows.min(initial=0) < 0:
            return None
        limits = {
            key: _limits(data, KEYS[key], chunks[:, place, TYPE], statistics[:, i])
            for i, (key, place) in enumerate(keys.items())
        }
    except (IndexError, ValueError):  # UnicodeDecodeError is a ValueError
        return None
    groups = RowGroups(rows.tolist(), limits)
    return Footer(groups, schema.names, schema.leaves, chunks, schema.lists, schema.plans)


def _known_schema(data: bytes, elements: NDArray[np.int64]) -> Schema:
    """As ``_schema``, worked out once for all files of a kind: theirs begin with the same bytes."""
    names = elements[:, 1]
    key = data[: max(int(names.sum(axis=1).max()), 0)], elements.tobytes()
    if key not in _SCHEMAS:
        if len(_SCHEMAS) >= _SCHEMAS_KEPT:
            _SCHEMAS.clear()
        _SCHEMAS[key] = _schema(data, elements.tolist())
    return _SCHEMAS[key]


def _schema(data: bytes, elements: list[list[list[int]]]) -> Schema:
    """From value and length of the fields of each element: repetition, name, elements, meaning."""
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
    return Schema(leaves, lists, frozenset(names), place, {})


def _limits(
    data: bytes, meant: type, kinds: NDArray[np.int64], statistics: NDArray[np.int64]
) -> tuple[list[Any], list[Any]]:
    """Of each group the least and greatest value of a key; None where they are not exact."""
    missing, greatest, greatest_size, least, least_size, *exact = statistics.T
    usual = np.isin(kinds, (BYTES,) if meant is str else (INT32, INT64))
    usual &= (missing <= 0) & (greatest >= 0) & (least >= 0) & (exact[0] != 0) & (exact[1] != 0)
    low = _told(data, meant, usual, least, least_size)
    return low, _told(data, meant, usual, greatest, greatest_size)


def _told(
    data: bytes,
    meant: type,
    usual: NDArray[np.bool_],
    places: NDArray[np.int64],
    sizes: NDArray[np.int64],
) -> list[Any]:
    """Values by where their bytes are, each made once; None where they are not ``usual``."""
    begins = np.where(usual, places, -1).tolist()
    ends = (places + sizes).tolist()
    parts = [None if i < 0 else data[i:j] for i, j in zip(begins, ends, strict=True)]
    known: dict[bytes | None, Any] = {None: None}
    for part in set(parts) - {None}:
        assert part is not None
        known[part] = part.decode() if meant is str else int.from_bytes(part, "little", signed=True)
    return [known[part] for part in parts]
