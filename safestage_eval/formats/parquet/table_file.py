"""A table of a dataset, read by pyarrow: whole, or the rows of one episode."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import local
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval.errors import TraceError
from safestage_eval.formats.remote_path import RemotePath
from safestage_eval.formats.trace_files import arrow_file, file_state
from safestage_eval.size_limits import current

from .arrow_columns import demand_words, is_text, numbers
from .arrow_tables import columns_of

EPISODE = "episode_index"

LARGEST = 1 << 32
"""Most bytes that the rows read at once may take: hours of a crowded scene."""

_WHOLE_BYTES = 1 << 20
"""Size up to which a file is read at once: each column chunk would take system calls of its own."""

_FILES_KEPT = 16
"""Files that a thread keeps open: those of two shards. To open one takes longer the more groups it has."""

_KEPT = local()
"""``files`` of each thread, by key, the one that was used last at the end."""

_DAMAGE = (pa.ArrowException, OSError, ValueError, IndexError, MemoryError)


@dataclass(eq=False)
class _Open:
    """A Parquet file that is open.

    Attributes:
        file: as pyarrow has it; texts come as dictionaries, where one that stands in many rows takes room once.
        size: in bytes.
        types: Arrow types of the columns.
        lists: places of the values of columns of lists, by column.
        ends: (G, 2) least and most episode index in each row group, as its statistics say.
        shared: row groups and columns that were read last, and their rows, where they are of several episodes.
    """

    file: pq.ParquetFile
    size: int
    types: Mapping[str, pa.DataType]
    lists: Mapping[str, list[int]]
    ends: NDArray[np.int64]
    shared: tuple[Any, pa.Table | None] = (None, None)


def forget() -> None:
    """Forget what this thread keeps of files, so that they are read anew."""
    _KEPT.__dict__.clear()


class TableFile:
    """A file of one table. Nothing but its footer is read when it is opened.

    Attributes:
        path: of the file.
        key: path and state of the file, another one when its content is another.
    """

    def __init__(self, path: Path, table: str) -> None:
        """Open it; raises TraceError where there is no file, or none that can be read."""
        self.path, self._names = path, list(columns_of(table))
        try:
            state, size = file_state(path)
        except (FileNotFoundError, NotADirectoryError):
            raise TraceError(
                str(path),
                f"the table {table!r} is missing.",
                fix="copy the dataset again, with all of its folders",
            ) from None
        except OSError as error:
            raise TraceError(str(path), f"cannot be read: {error.strerror or error}") from None
        self.key: Hashable = path, state
        kept: OrderedDict[Hashable, _Open] = _KEPT.__dict__.setdefault("files", OrderedDict())
        if self.key not in kept:
            try:
                kept[self.key] = _opened(path, size, table)
            except _DAMAGE as error:
                raise self._unreadable(error) from None
            if len(kept) > _FILES_KEPT:
                kept.popitem(last=False)
        kept.move_to_end(self.key)
        self._open = kept[self.key]

    @property
    def described(self) -> list[str]:
        """The columns that it has of those described for its table, in their order."""
        return [name for name in self._names if name in self._open.types]

    def read(self, columns: Iterable[str], episode: int | None = None) -> pa.Table:
        """Read columns, in the order given: all rows, or those of one episode in stored order.

        Raises:
            TraceError: a column is missing, the bytes are damaged, or there are too many rows.
        """
        names, opened = list(columns), self._open
        if episode is None:
            return self._read(range(len(opened.ends)), names)
        least, most = opened.ends.T
        groups = np.flatnonzero((least <= episode) & (episode <= most)).tolist()
        key = groups, names
        rows = opened.shared[1]
        if rows is None or opened.shared[0] != key:
            rows = self._read(groups, [*names, *{EPISODE}.difference(names)])
        own = numbers(rows, EPISODE, np.int64, str(self.path)) == episode  # whatever statistics say
        if own.all():
            return rows.select(names)
        opened.shared = key, rows
        places = np.flatnonzero(own)
        if len(places) and places[-1] - places[0] + 1 == len(places):
            return rows.slice(places[0], len(places)).select(names)
        return rows.take(pa.array(places)).select(names)

    def _read(self, groups: Sequence[int], columns: Sequence[str]) -> pa.Table:
        """Read all rows of some row groups. Raises TraceError as ``read``."""
        opened, where = self._open, str(self.path)
        try:
            stated = [opened.file.metadata.row_group(group) for group in groups]
            rows = sum(group.num_rows for group in stated)
            values = rows * len(columns)
            for place in (place for name in columns for place in opened.lists.get(name, ())):
                values += sum(max(0, group.column(place).num_values) for group in stated)
            current().demand_decoded(4 * values, opened.size, where)
            if 4 * rows * len(columns) > LARGEST:
                raise TraceError(
                    where,
                    f"{rows:,} rows would have to be read at once.",
                    f"{LARGEST // 4 // len(columns):,} rows of {len(columns)} columns",
                    "write row groups of one episode each",
                )
            table = opened.file.read_row_groups(groups, columns=list(columns), use_threads=False)
            if table.column_names != list(columns):
                raise self._other_columns(table.column_names, columns)
            for name in columns:
                if len(table[name]) != rows:
                    what = f"{len(table[name])} values of {name!r} in {rows} rows."
                    raise TraceError(where, what, fix="copy the dataset again")
                if pa.types.is_dictionary(table[name].type):
                    for words in table[name].chunks:
                        demand_words(words, name, where)
        except _DAMAGE as error:
            raise self._unreadable(error) from None
        return table

    def _other_columns(self, read: list[str], wanted: Sequence[str]) -> TraceError:
        name = next((name for name in wanted if read.count(name) != 1), wanted[0])
        if name in read:
            what = f"the column {name!r} is there {read.count(name)} times."
            return TraceError(str(self.path), what, "once")
        there = ", ".join(sorted(self._open.types))
        what = f"the column {name!r} is missing; there are {there}."
        return TraceError(str(self.path), what, ", ".join(self._names))

    def _unreadable(self, error: Exception) -> TraceError:
        try:
            size = file_state(self.path)[1]
        except OSError:
            return TraceError(str(self.path), f"cannot be read: {error}")
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        return TraceError(
            str(self.path),
            f"not a whole Parquet file ({size} bytes): {why}.",
            "a file that ends with its footer",
            "copy it again, or record the episode again",
        )


def _opened(path: Path, size: int, table: str) -> _Open:
    stream: Any = arrow_file(path)
    if size <= _WHOLE_BYTES:
        stream = pa.BufferReader(stream.read_at(size, 0))
    options = {
        "pre_buffer": isinstance(path, RemotePath),
        "page_checksum_verification": True,
    }
    texts = [name for name, column in columns_of(table).items() if column.type == "string"]
    try:
        file = pq.ParquetFile(stream, read_dictionary=texts, **options)
    except KeyError:  # one of them is not there
        file = pq.ParquetFile(stream, **options)
    metadata, arrow = file.metadata, file.schema_arrow
    types = dict(zip(arrow.names, arrow.types, strict=True))
    if texts := [name for name, kind in types.items() if is_text(kind)]:  # of other writers
        file = pq.ParquetFile(stream, metadata=metadata, read_dictionary=texts, **options)
    paths = [metadata.schema.column(i).path for i in range(len(metadata.schema))]
    lists: dict[str, list[int]] = {}
    for place, column in enumerate(paths):
        name = column.partition(".")[0]
        if name in types and pa.types.is_nested(types[name]):
            lists.setdefault(name, []).append(place)
    return _Open(file, size, types, lists, _episodes(metadata, paths))


def _episodes(metadata: pq.FileMetaData, paths: Sequence[str]) -> NDArray[np.int64]:
    """(G, 2) least and most episode index in each row group; the widest where none is stated."""
    limits = np.iinfo(np.int64)
    ends = np.tile([limits.min, limits.max], (metadata.num_row_groups, 1))
    if EPISODE in paths:
        place = paths.index(EPISODE)
        for group in range(len(ends)):
            column = metadata.row_group(group).column(place)
            if column.physical_type != metadata.schema.column(place).physical_type:
                continue  # asking for its statistics would end the process
            stated = column.statistics
            if stated is not None and stated.has_min_max and isinstance(stated.min, int):
                ends[group] = stated.min, stated.max
    return ends
