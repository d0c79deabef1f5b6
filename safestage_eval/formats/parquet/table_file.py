"""A table of a dataset, read by pyarrow: whole, or the rows of one episode."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from threading import local
from typing import Any

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

_FEW_ROWS, _FEW_GROUPS = 1 << 20, 64
"""Rows and row groups of a file up to which it is first read as if all were one episode's: earlier versions
wrote a row group for each body."""

EPISODE = "episode_index"

Rows = slice | NDArray[np.intp]
"""Rows of a row group, ascending."""


@dataclass(eq=False)
class _Known:
    """The metadata of a Parquet file, and which rows belong to which episode (found once).

    Attributes:
        metadata: as pyarrow has it.
        types: Arrow types of the columns.
        lists: places of the values of columns of lists, by column.
        rows: episode → (row group, its rows there); None until somebody asks.
    """

    metadata: pq.FileMetaData
    types: Mapping[str, pa.DataType]
    lists: Mapping[str, list[int]]
    rows: dict[int, list[tuple[int, Rows]]] | None = field(default=None, repr=False)


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
        metadata = self._known.metadata
        groups = range(metadata.num_row_groups)
        if episode is None:
            return self._read(groups, columns)
        few = metadata.num_rows <= _FEW_ROWS and len(groups) <= _FEW_GROUPS
        if self._known.rows is None and few:
            table = self._read(groups, [*columns, EPISODE])
            own = numbers(table, EPISODE, np.int64, str(self.path)) == episode
            if own.all():
                return table.select(columns)
        places = self._rows().get(episode, [])
        if all(isinstance(rows, slice) for _, rows in places):
            counts = [metadata.row_group(group).num_rows for group, _ in places]
            if [slice(0, count) for count in counts] == [rows for _, rows in places]:
                return self._read([group for group, _ in places], columns)
        parts = []
        for group, rows in places:
            table = self._shared(group).select(columns)
            if isinstance(rows, slice):
                parts.append(table.slice(rows.start, rows.stop - rows.start))
            else:
                parts.append(table.take(pa.array(rows)))
        return pa.concat_tables(parts)

    def _rows(self) -> dict[int, list[tuple[int, Rows]]]:
        """Return the places of the rows of each episode."""
        if self._known.rows is None:
            found: dict[int, list[tuple[int, Rows]]] = {}
            metadata = self._known.metadata
            groups = range(metadata.num_row_groups)
            counts = [metadata.row_group(group).num_rows for group in groups]
            table = self._read(groups, [EPISODE])
            whose = numbers(table, EPISODE, np.int64, str(self.path))
            for group, part in enumerate(np.split(whose, np.cumsum(counts)[:-1])):
                for episode, rows in _by_value(part):
                    found.setdefault(episode, []).append((group, rows))
            self._known.rows = found
        return self._known.rows

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
        except (pa.ArrowException, OSError, ValueError) as error:  # a name may be no text
            raise self._unreadable(error) from None
        types = dict(zip(arrow.names, arrow.types, strict=True))
        lists: dict[str, list[int]] = {}
        for place, path in enumerate(paths):
            name = path.partition(".")[0]
            if name in types and pa.types.is_nested(types[name]):
                lists.setdefault(name, []).append(place)
        return _Known(metadata, types, lists)

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
        if self._source is None and self._known.metadata.num_row_groups > _FEW_GROUPS:
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


def _by_value(values: NDArray[Any]) -> Iterable[tuple[int, Rows]]:
    """Return each value and its rows."""
    if not len(values):
        return
    order = np.argsort(values, kind="stable")
    some = values[order]
    edges = [0, *(np.flatnonzero(some[1:] != some[:-1]) + 1).tolist(), len(some)]
    for begin, end in pairwise(edges):
        rows = order[begin:end]
        first, last = int(rows[0]), int(rows[-1])
        together = last - first + 1 == len(rows)
        yield int(some[begin]), slice(first, last + 1) if together else rows
