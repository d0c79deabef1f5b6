"""A table of a dataset, read by pyarrow: whole, or the rows of one episode."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import local

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval.errors import TraceError
from safestage_eval.formats.byte_source import SourceStream
from safestage_eval.formats.remote_path import RemotePath
from safestage_eval.formats.trace_files import regular_status
from safestage_eval.size_limits import current

from .arrow_tables import arrow_file, columns_of
from .arrow_values import check_words, is_text, numbers

LARGEST = 1 << 32
"""Most bytes that the rows read at once may take: hours of a crowded scene."""

_WHOLE_BYTES = 1 << 20
"""Size up to which a local file is read at once: each column chunk would take system calls of its own."""

_OPEN = local()
"""Files of many episodes that this thread has open, by key: opening one takes longer the more it has."""

_FILES_KEPT = 16
"""Files of which it is remembered whose rows are where: those of two shards."""

_KEPT_BYTES = 128 << 20
"""Most bytes of decoded row groups that are kept, because several episodes share them."""

_MANY_GROUPS = 64
"""Row groups of a file from which on it is kept open."""

EPISODE = "episode_index"


@dataclass(eq=False)
class _Known:
    """The metadata of a Parquet file (looked at once).

    Attributes:
        metadata: as pyarrow has it.
        types: Arrow types of the columns.
        lists: places of the values of columns of lists, by column.
        least, most: (G,) episode indices in each row group, as its statistics say.
    """

    metadata: pq.FileMetaData
    types: Mapping[str, pa.DataType]
    lists: Mapping[str, list[int]]
    least: NDArray[np.int64]
    most: NDArray[np.int64]


_FILES: OrderedDict[Hashable, _Known] = OrderedDict()
_GROUPS: OrderedDict[tuple[Hashable, int], pa.Table] = OrderedDict()
"""Decoded row groups that several episodes share, the one that was used last at the end."""


def forget() -> None:
    """Forget what is kept of files, so that they are read anew."""
    _FILES.clear()
    _GROUPS.clear()
    _OPEN.__dict__.clear()


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
            stat = regular_status(path)
            self._source = path.source() if isinstance(path, RemotePath) else None
        except (FileNotFoundError, NotADirectoryError):
            raise TraceError(
                str(path),
                f"the table {table!r} is missing.",
                fix="copy the dataset again, with all of its folders",
            ) from None
        except OSError as error:
            raise TraceError(str(path), f"cannot be read: {error.strerror or error}") from None
        self._size = stat.st_size
        state: Hashable = (
            (stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size, stat.st_ino)
            if self._source is None
            else self._source.state
        )
        self.key = path, state
        known = _FILES.get(self.key)
        if known is None:
            known = self._look()
        self._known = _FILES[self.key] = known
        _FILES.move_to_end(self.key)
        if len(_FILES) > _FILES_KEPT:
            _FILES.popitem(last=False)

    @property
    def types(self) -> Mapping[str, pa.DataType]:
        """Arrow types of the columns, by name."""
        return self._known.types

    def read(self, columns: Iterable[str], episode: int | None = None) -> pa.Table:
        """Read columns, in the order given: all rows, or those of one episode in stored order.

        Texts come as dictionaries: one that stands in many rows takes room once.

        Raises:
            TraceError: a column is missing, the bytes are damaged, or there are too many rows.
        """
        columns = list(dict.fromkeys(columns))
        known = self._known
        if episode is None:
            return self._read(range(known.metadata.num_row_groups), columns)
        there = np.flatnonzero((known.least <= episode) & (episode <= known.most))
        if (known.least[there] == known.most[there]).all():
            table = self._read(there.tolist(), [*columns, EPISODE])
            return self._own(table, episode).select(columns)
        parts = [
            self._own(self._shared(group), episode).select(columns) for group in there.tolist()
        ]
        return pa.concat_tables(parts)

    def _own(self, table: pa.Table, episode: int) -> pa.Table:
        """Return the rows of an episode: statistics are not believed."""
        own = numbers(table, EPISODE, np.int64, str(self.path)) == episode
        if own.all():
            return table
        rows = np.flatnonzero(own)
        if len(rows) and rows[-1] - rows[0] + 1 == len(rows):
            return table.slice(rows[0], len(rows))
        return table.take(pa.array(rows))

    def _shared(self, group: int) -> pa.Table:
        """Read a row group that several episodes share; it is kept for the next one, if there is room."""
        key = self.key, group
        table = _GROUPS.get(key)
        if table is None:
            names = [name for name in self._names if name in self._known.types]
            table = self._read([group], names)
            _GROUPS[key] = table
            while len(_GROUPS) > 1 and sum(t.nbytes for t in _GROUPS.values()) > _KEPT_BYTES:
                _GROUPS.popitem(last=False)
        else:
            _GROUPS.move_to_end(key)
        return table

    def _look(self) -> _Known:
        try:
            metadata = self._opened(None, ()).metadata
            arrow = metadata.schema.to_arrow_schema()
            paths = [metadata.schema.column(i).path for i in range(len(metadata.schema))]
            ends = _episodes(metadata, paths)
        except (pa.ArrowException, OSError, ValueError) as error:  # a name may be no text
            raise self._unreadable(error) from None
        types = dict(zip(arrow.names, arrow.types, strict=True))
        lists: dict[str, list[int]] = {}
        for place, path in enumerate(paths):
            name = path.partition(".")[0]
            if name in types and pa.types.is_nested(types[name]):
                lists.setdefault(name, []).append(place)
        return _Known(metadata, types, lists, *ends)

    def _file(self) -> pq.ParquetFile:
        """The file, opened with its texts as dictionaries; kept open if it is local and many episodes may share it."""
        kept: OrderedDict[Hashable, pq.ParquetFile] = _OPEN.__dict__.setdefault(
            "files", OrderedDict()
        )
        if self.key in kept:
            kept.move_to_end(self.key)
            return kept[self.key]
        texts = [name for name, kind in self._known.types.items() if is_text(kind)]
        file = self._opened(self._known.metadata, texts)
        if self._source is None and self._known.metadata.num_row_groups > _MANY_GROUPS:
            kept[self.key] = file
            if len(kept) > _FILES_KEPT:
                kept.popitem(last=False)
        return file

    def _opened(self, metadata: pq.FileMetaData | None, texts: Sequence[str]) -> pq.ParquetFile:
        if self._source is not None:
            stream = pa.PythonFile(SourceStream(self._source), "r")
        else:
            stream = arrow_file(self.path)
            if stream.size() <= _WHOLE_BYTES:
                stream = pa.BufferReader(stream.read_buffer())
        return pq.ParquetFile(
            stream,
            metadata=metadata,
            read_dictionary=list(texts),
            pre_buffer=self._source is not None,
            page_checksum_verification=True,
        )

    def _read(self, groups: Sequence[int], columns: Sequence[str]) -> pa.Table:
        """Read all rows of some row groups. Raises TraceError as ``read``."""
        known = self._known
        rows = sum(known.metadata.row_group(group).num_rows for group in groups)
        self._demand_room(groups, columns, rows)
        try:
            table = self._file().read_row_groups(groups, columns=list(columns), use_threads=False)
            if table.column_names != list(columns):
                raise self._other_columns(table.column_names, columns)
            for name in columns:
                if pa.types.is_dictionary(table[name].type):
                    for words in table[name].chunks:
                        check_words(words, name, str(self.path))
        except (pa.ArrowException, OSError, UnicodeDecodeError, MemoryError) as error:
            raise self._unreadable(error) from None
        try:
            table.validate()  # columns of equal length
            same = table.num_rows == rows
        except pa.ArrowInvalid:
            same = False
        if not same:
            name = next((name for name in columns if len(table[name]) != rows), columns[0])
            raise TraceError(
                str(self.path),
                f"{len(table[name])} values of {name!r} in {rows} rows.",
                fix="copy the dataset again",
            )
        return table

    def _demand_room(self, groups: Sequence[int], columns: Sequence[str], rows: int) -> None:
        """Compare what some row groups become with the limits. Raises TraceError."""
        values = rows * len(columns)
        places = [place for name in columns for place in self._known.lists.get(name, ())]
        try:
            for group in groups:
                stated = self._known.metadata.row_group(group)
                values += sum(max(0, stated.column(place).num_values) for place in places)
        except (pa.ArrowException, OSError, ValueError, IndexError) as error:
            raise self._unreadable(error) from None
        current().demand_decoded(4 * values, self._size, str(self.path))
        if 4 * rows * len(columns) > LARGEST:
            raise TraceError(
                str(self.path),
                f"{rows:,} rows would have to be read at once.",
                f"{LARGEST // 4 // len(columns):,} rows of {len(columns)} columns",
                "write row groups of one episode each",
            )

    def _other_columns(self, read: list[str], wanted: Sequence[str]) -> TraceError:
        name = next((name for name in wanted if read.count(name) != 1), wanted[0])
        if name not in read:
            return TraceError(
                str(self.path),
                f"the column {name!r} is missing; there are {', '.join(sorted(self.types))}.",
                ", ".join(self._names),
            )
        return TraceError(
            str(self.path), f"the column {name!r} is there {read.count(name)} times.", "once"
        )

    def _unreadable(self, error: Exception) -> TraceError:
        try:
            size = self.path.stat().st_size
        except OSError:
            return TraceError(str(self.path), f"cannot be read: {error}")
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        return TraceError(
            str(self.path),
            f"not a whole Parquet file ({size} bytes): {why}.",
            "a file that ends with its footer",
            "copy it again, or record the episode again",
        )


def _episodes(
    metadata: pq.FileMetaData, paths: Sequence[str]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the (G,) least and most episode index in each row group; the widest where none is stated."""
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
    return ends[:, 0], ends[:, 1]
