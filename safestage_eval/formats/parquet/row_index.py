"""The row-group index of a Parquet file: which rows of which row groups belong to whom.

Rows of a table are looked up by episode and by the bodies that they are about. Files written here
state that in their key-value metadata, so that no statistics are touched and no column of names is
read. For all other files it follows from the statistics of the row groups, where each holds rows of
one body or pair; where they hold several, the key columns are read once (``runs_of``).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .arrow_values import coded_words, numbers
from .column_chunks import Chunk

METADATA_KEY = b"safestage.row_index"

EPISODE = "episode_index"
NAME_COLUMNS = {"bodies": ("body",), "contacts": ("body1", "body2"), "channels": ("body",)}
"""Table → columns with the names that its rows are looked up by, besides ``episode_index``."""

Names = tuple[str | None, ...]
"""Names of the bodies of a row, as many as the table has name columns."""

Rows = slice | NDArray[np.intp]
"""Rows of a row group, ascending."""


class Run(NamedTuple):
    """Consecutive rows of a row group with the same keys."""

    episode: int
    names: Names
    rows: int


class Place(NamedTuple):
    """Rows of a row group."""

    group: int
    rows: Rows


Members = Mapping[tuple[int, Names], Rows]
"""Episode and names → their rows in a row group."""


class RowIndex:
    """Whose rows the row groups of a file hold, as far as its footer says.

    Attributes:
        rows: how many rows each row group has.
        members: whose rows each holds; None where its key columns have to be read.
        episodes: least and greatest episode of each; None where that is not known.
        stated: the file itself has the index.
    """

    def __init__(
        self,
        rows: Sequence[int],
        members: Sequence[Members | None],
        episodes: Sequence[tuple[int, int] | None],
        *,
        stated: bool = False,
    ) -> None:
        """Arguments as the attributes of the class."""
        self.rows, self.stated = rows, stated
        self.members, self.episodes = list(members), episodes
        self._by_episode: dict[int, list[int]] = {}
        self._unknown: list[tuple[int, tuple[int, int] | None]] = []
        for number, runs in enumerate(members):
            if runs is None:
                self._unknown.append((number, episodes[number]))
                continue
            for episode in dict.fromkeys(key[0] for key in runs):
                self._by_episode.setdefault(episode, []).append(number)

    def groups_of(self, episode: int) -> list[int]:
        """Return the row groups that hold, or may hold, rows of an episode, in the file's order."""
        certain = self._by_episode.get(episode, [])
        if not self._unknown:
            return certain
        maybe = [n for n, ends in self._unknown if ends is None or ends[0] <= episode <= ends[1]]
        return sorted([*certain, *maybe])


def load_row_index(
    metadata: pq.FileMetaData,
    table: str | None,
    file_size: int,
    chunks: Callable[[], Sequence[Sequence[Chunk]]],
) -> RowIndex:
    """Return the index that a file states, or the one that follows from its statistics.

    Args:
        metadata: of the file.
        table: name of the table; None for one that is always read whole.
        file_size: in bytes; an index that was copied from another file does not fit.
        chunks: the columns of each row group; asked where the file states no index.

    Raises:
        ValueError: the footer cannot be read.
    """
    rows = [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)]
    if table is None:
        return RowIndex(rows, [None] * len(rows), [None] * len(rows))
    text = (metadata.metadata or {}).get(METADATA_KEY)
    if text is not None:
        end = file_size - 8 - metadata.serialized_size
        groups = _decoded(text, rows, end, len(NAME_COLUMNS.get(table, ())))
        if groups is not None:
            members = [runs_to_members(runs) for runs in groups]
            return RowIndex(rows, members, [None] * len(rows), stated=True)
    return _from_statistics(metadata, table, rows, chunks())


def encode_row_index(groups: Sequence[Sequence[Run]], end: int) -> bytes:
    """Return the text that ``load_row_index`` reads.

    Args:
        groups: the runs of each row group.
        end: bytes of the file up to its footer.
    """
    names: dict[str | None, int] = {}
    for run in (run for runs in groups for run in runs):
        for name in run.names:
            names.setdefault(name, len(names))
    coded = [[[run.episode, *(names[n] for n in run.names), run.rows] for run in g] for g in groups]
    index = {"version": 1, "end": end, "names": list(names), "groups": coded}
    return json.dumps(index, separators=(",", ":"), ensure_ascii=False).encode()


def _decoded(text: bytes, rows: Sequence[int], end: int, width: int) -> list[list[Run]] | None:
    """The runs of each row group; None for an index that is damaged or of another file."""
    try:
        index = json.loads(text)
        names, groups = index["names"], index["groups"]
        if index["version"] != 1 or index["end"] != end or len(groups) != len(rows):
            return None
        if not all(isinstance(name, str) for name in names):
            return None
        if not all(type(n) is int and n >= 0 for group in groups for run in group for n in run):
            return None
        decoded = [
            [Run(run[0], tuple(names[n] for n in run[1:-1]), run[-1]) for run in group]
            for group in groups
        ]
    except (ValueError, KeyError, TypeError, IndexError, RecursionError):
        return None
    fits = all(
        sum(run.rows for run in runs) == count and all(len(run.names) == width for run in runs)
        for runs, count in zip(decoded, rows, strict=True)
    )
    return decoded if fits else None


def _from_statistics(
    metadata: pq.FileMetaData, table: str, rows: Sequence[int], chunks: Sequence[Sequence[Chunk]]
) -> RowIndex:
    """Row groups of one episode and one body or pair have known members, all others unknown ones."""
    if len(chunks) != len(rows):
        raise ValueError(f"{len(chunks)} row groups are described, and {len(rows)} counted")
    schema = metadata.schema
    paths = [schema.column(i).path for i in range(metadata.num_columns)]
    keys = [
        _Key.of(schema.column(paths.index(name)), paths.index(name), kind)
        for name, kind in ((EPISODE, int), *((name, str) for name in NAME_COLUMNS.get(table, ())))
        if name in paths
    ]
    complete = len(keys) == 1 + len(NAME_COLUMNS.get(table, ()))
    members: list[Members | None] = []
    episodes: list[tuple[int, int] | None] = []
    for group, count in zip(chunks, rows, strict=True):
        whole = len(group) == len(paths)
        ends = [_limits(group[key.place], key) if whole else None for key in keys]
        single = [pair[0] for pair in ends if pair is not None and pair[0] == pair[1]]
        uniform = complete and len(single) == len(keys)
        members.append({(single[0], tuple(single[1:])): slice(0, count)} if uniform else None)
        episodes.append(ends[0] if keys and paths[keys[0].place] == EPISODE else None)
    return RowIndex(rows, members, episodes)


_SIZES = {"INT32": 4, "INT64": 8}
"""Physical type of whole numbers → bytes of one."""


class _Key(NamedTuple):
    """A key column: its place in a row group, its physical type, and that of its values here.

    ``kind`` is None where the schema has values of another type.
    """

    place: int
    physical_type: str
    kind: type | None

    @classmethod
    def of(cls, column: pq.ColumnSchema, place: int, kind: type) -> _Key:
        logical = json.loads(column.logical_type.to_json())
        if kind is int:
            fits = logical["Type"] == "None" or logical.get("isSigned", False)
            fits = fits and column.physical_type in _SIZES
        else:
            fits = logical["Type"] == "String" and column.physical_type == "BYTE_ARRAY"
        return cls(place, column.physical_type, kind if fits else None)


def _limits(chunk: Chunk, key: _Key) -> Any:
    """Least and greatest value of a column in a row group; None where it does not say.

    A column whose chunk states another type than the schema says nothing.
    """
    if chunk.least is None or chunk.greatest is None or chunk.nulls:
        return None
    if chunk.physical_type != key.physical_type:
        return None
    ends = chunk.least, chunk.greatest
    if key.kind is int:
        whole = all(len(end) == _SIZES[key.physical_type] for end in ends)
        return tuple(int.from_bytes(e, "little", signed=True) for e in ends) if whole else None
    try:
        return tuple(end.decode() for end in ends) if key.kind is str else None
    except UnicodeDecodeError:
        return None


def runs_to_members(runs: Iterable[Run]) -> Members:
    """Return the rows of each episode and names."""
    parts: dict[tuple[int, Names], list[tuple[int, int]]] = {}
    begin = 0
    for episode, names, rows in runs:
        spans_of_key = parts.setdefault((episode, names), [])
        if spans_of_key and spans_of_key[-1][1] == begin:
            spans_of_key[-1] = spans_of_key[-1][0], begin + rows
        else:
            spans_of_key.append((begin, begin + rows))
        begin += rows
    return {
        key: slice(*spans[0])
        if len(spans) == 1
        else np.concatenate([np.arange(*span, dtype=np.intp) for span in spans])
        for key, spans in parts.items()
    }


def _key_runs(
    episodes: NDArray[Any], names: Sequence[tuple[NDArray[Any], Sequence[Any]]]
) -> list[Run]:
    """Return the runs of consecutive rows with the same keys.

    Args:
        episodes: (N,) whole numbers.
        names: of each name column (N,) codes, and the names that they stand for.
    """
    if not len(episodes):
        return []
    new = episodes[1:] != episodes[:-1]
    for codes, _ in names:
        new = new | (codes[1:] != codes[:-1])
    starts = np.concatenate([[0], np.flatnonzero(new) + 1])
    lengths = np.diff(starts, append=len(episodes))
    columns = [[words[code] for code in codes[starts].tolist()] for codes, words in names]
    return [
        Run(episode, tuple(column[i] for column in columns), length)
        for i, (episode, length) in enumerate(
            zip(episodes[starts].tolist(), lengths.tolist(), strict=True)
        )
    ]


def runs_of(table: str, rows: pa.Table, where: str = "") -> list[Run]:
    """Return the runs of consecutive rows with the same keys.

    Args:
        table: name of the table.
        rows: its key columns, or all.
        where: for messages.

    Raises:
        TraceError: a key column holds no whole numbers, or no names.
    """
    episodes = numbers(rows, EPISODE, np.int64, where)
    names = [coded_words(rows, column, where) for column in NAME_COLUMNS.get(table, ())]
    return _key_runs(episodes, names)
