"""A Parquet file opened through pyarrow: its metadata, row groups and columns, within bounds of memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from safestage_eval.errors import TraceError
from safestage_eval.formats.byte_source import SourceStream
from safestage_eval.formats.remote_path import RemotePath
from safestage_eval.formats.trace_files import regular_status
from safestage_eval.size_limits import current

from .arrow_tables import arrow_file, columns_of
from .arrow_values import NUMBERS, check_words, decoded
from .column_chunks import Chunk, read_chunks, read_chunks_of
from .row_index import RowIndex, load_row_index

LARGEST = 1 << 32
"""Most bytes that the rows read at once may take: hours of a crowded scene."""

_KEPT_BYTES = 96 << 20
"""Most bytes of decoded columns that are kept, of row groups that several bodies or episodes share."""

_WHOLE_BYTES = 8 << 20
"""Size up to which a local file is read at once: each column chunk would take system calls of its own."""

_FILES_KEPT = 12
"""Files whose metadata are kept: those of two shards. Of 50 episodes, a shard's take some 6 MB."""

SMALL = 1 << 22
"""Bytes of texts that are not counted any closer."""

EPISODES_TABLE = "meta/episodes"
"""The table that is always read whole, and needs no row index."""


class Layout:
    """The columns of a file, whose order and types most files of a table share.

    Attributes:
        types: of the columns, by name, of lists and records too.
        plain, shared, nested: columns of plain texts, of texts in a dictionary, and of lists or
            records. Many rows may share one text, and each would come to hold a copy; a row of a
            list may hold any number of values.
        leaves: column of lists or records → places of what lies in it.
    """

    def __init__(self, schema: pq.ParquetSchema, arrow: pa.Schema) -> None:
        """Look at every column of the schema, which is also given as Arrow's."""
        self.types: dict[str, pa.DataType] = dict(zip(arrow.names, arrow.types, strict=True))
        wide = {name: kind for name, kind in self.types.items() if kind.id not in NUMBERS}
        self.plain = frozenset(name for name, kind in wide.items() if _is_text(kind))
        self.shared = frozenset(n for n, kind in wide.items() if pa.types.is_dictionary(kind))
        self.nested = frozenset(n for n, kind in wide.items() if pa.types.is_nested(kind))
        self.leaves: dict[str, list[int]] = {}
        if self.nested:
            for place in range(len(schema)):
                name = schema.column(place).path.partition(".")[0]
                if name in self.nested:
                    self.leaves.setdefault(name, []).append(place)


_LAYOUTS: list[tuple[pa.Schema, Layout]] = []
"""Layouts of files that were met lately, by schema (Parquet's would keep their footers in memory)."""


def _layout_of(schema: pq.ParquetSchema) -> Layout:
    arrow = schema.to_arrow_schema()
    for known, layout in _LAYOUTS:
        if known.equals(arrow):
            return layout
    layout = Layout(schema, arrow)
    _LAYOUTS[:] = [(arrow, layout), *_LAYOUTS[: _FILES_KEPT - 1]]
    return layout


@dataclass(eq=False)
class Footer:
    """The metadata of a file.

    Attributes:
        metadata: as pyarrow has it.
        index: which rows belong to whom.
        values: of each column in each row group; None until somebody asks.
    """

    metadata: pq.FileMetaData
    index: RowIndex
    values: list[list[int]] | None = None

    @cached_property
    def layout(self) -> Layout:
        """Its columns."""
        return _layout_of(self.metadata.schema)


FOOTERS: dict[tuple[Path, Hashable], Footer] = {}
"""By path and state of the file: shards hold many episodes, and their footers are large."""


def _is_text(kind: pa.DataType) -> bool:
    types = pa.types
    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_binary(kind))


class _ColumnCache:
    """Decoded columns by file, row group and name, the least recently used of them dropped."""

    def __init__(self, most: int) -> None:
        self._most, self._bytes = most, 0
        self._columns: OrderedDict[tuple[Hashable, int, str], pa.ChunkedArray] = OrderedDict()

    def get(self, key: tuple[Hashable, int, str]) -> pa.ChunkedArray | None:
        """Return the column, or None."""
        column = self._columns.get(key)
        if column is not None:
            self._columns.move_to_end(key)
        return column

    def put(self, key: tuple[Hashable, int, str], column: pa.ChunkedArray) -> None:
        """Keep a column, unless it alone is too large."""
        if column.nbytes > self._most or key in self._columns:
            return
        self._columns[key] = column
        self._bytes += column.nbytes
        while self._bytes > self._most:
            self._bytes -= self._columns.popitem(last=False)[1].nbytes

    def forget(self, file: Hashable) -> None:
        """Drop the columns of a file that is not read any more."""
        for key in [key for key in self._columns if key[0] == file]:
            self._bytes -= self._columns.pop(key).nbytes


_COLUMNS = _ColumnCache(_KEPT_BYTES)


class TableFile:
    """A file of one table. Nothing but its footer is read when it is opened.

    Attributes:
        path: of the file.
        names: the columns that the format has for this table.
        footer: what its end says; the same object as long as the file is the same.
    """

    def __init__(self, path: Path, table: str) -> None:
        """Open it; raises TraceError where there is no file, or none that can be read."""
        self.path, self.names = path, list(columns_of(table))
        try:
            stat = regular_status(path)
            source = path.source() if isinstance(path, RemotePath) else None
        except (FileNotFoundError, NotADirectoryError):
            raise TraceError(
                str(path),
                f"the table {table!r} is missing.",
                fix="copy the dataset again, with all of its folders",
            ) from None
        except OSError as error:
            raise TraceError(str(path), f"cannot be read: {error.strerror or error}") from None
        self._source, self._size = source, stat.st_size
        state: Hashable = (
            (stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size, stat.st_ino)
            if source is None
            else source.state
        )
        self._key = path, state
        cached = FOOTERS.get(self._key)
        self._metadata = cached.metadata if cached is not None else None
        self.footer = cached or self._read_footer(table, stat.st_size)
        FOOTERS[self._key] = self.footer
        if len(FOOTERS) > _FILES_KEPT:
            oldest = next(iter(FOOTERS))
            FOOTERS.pop(oldest, None)
            _COLUMNS.forget(oldest)

    def _read_footer(self, table: str, size: int) -> Footer:
        try:
            metadata = self._file.metadata
            kind = None if table == EPISODES_TABLE else table
            index = load_row_index(metadata, kind, size, lambda: self._chunks(metadata))
        except (pa.ArrowException, OSError, ValueError) as error:  # a name may be no text
            raise self._unreadable(error) from None
        return Footer(metadata, index)

    @cached_property
    def _file(self) -> pq.ParquetFile:
        return self._opened(None)

    @cached_property
    def _file_of_texts(self) -> pq.ParquetFile:
        """The same, which reads each text once."""
        return self._opened(sorted(self.footer.layout.plain))

    def _opened(self, texts: list[str] | None) -> pq.ParquetFile:
        if self._source is not None:
            stream = pa.PythonFile(SourceStream(self._source), "r")
        else:
            stream = arrow_file(self.path)
            if stream.size() <= _WHOLE_BYTES:
                stream = pa.BufferReader(stream.read_buffer())
        return pq.ParquetFile(
            stream,
            metadata=self._metadata if texts is None else self.footer.metadata,
            read_dictionary=texts,
            pre_buffer=self._source is not None,
            page_checksum_verification=True,
        )

    def read(self, groups: Sequence[int], columns: Sequence[str]) -> pa.Table:
        """Read all rows of some row groups, the columns in the order given, each once.

        Raises:
            TraceError: a column is missing, the bytes are damaged, or there are too many rows.
        """
        columns = list(dict.fromkeys(columns))
        rows = sum(self.footer.index.rows[group] for group in groups)
        layout = self.footer.layout
        values = rows * len(columns)
        if not layout.nested.isdisjoint(columns):
            values += self._in_lists(groups, columns)
        current().demand_decoded(4 * values, self._size, str(self.path))
        if 4 * rows * len(columns) > LARGEST:
            raise TraceError(
                str(self.path),
                f"{rows:,} rows would have to be read at once.",
                f"{LARGEST // 4 // len(columns):,} rows of {len(columns)} columns",
                "write row groups of one episode each" if len(self.footer.index.rows) == 1 else "",
            )
        texts = [name for name in columns if name in layout.plain] if rows > 1 else []
        file = self._file_of_texts if texts else self._file
        try:
            table = file.read_row_groups(groups, columns=columns, use_threads=False)
            if table.column_names != columns:
                raise self._other_columns(table.column_names, columns)
            for name in layout.shared.intersection(columns):
                for words in table[name].chunks:
                    check_words(words, name, str(self.path))
            if rows > 1 and (texts or not layout.shared.isdisjoint(columns)):
                table = self._unfolded(table, texts, layout.shared)
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

    def _in_lists(self, groups: Sequence[int], columns: Sequence[str]) -> int:
        """Values in the lists of some columns, as the footer states them. Raises TraceError."""
        footer = self.footer
        places = [place for name in columns for place in footer.layout.leaves.get(name, ())]
        try:
            if footer.values is None:
                stated = self._chunks(footer.metadata)
                footer.values = [[max(0, chunk.values) for chunk in group] for group in stated]
            return sum(footer.values[group][place] for group in groups for place in places)
        except IndexError:
            lacks = ValueError("the footer has row groups that lack columns")
            raise self._unreadable(lacks) from None
        except (OSError, ValueError) as error:
            raise self._unreadable(error) from None

    def _chunks(self, metadata: pq.FileMetaData) -> list[list[Chunk]]:
        """Read what the footer states of the columns. Raises OSError and ValueError."""
        size = metadata.serialized_size
        if self._source is None:
            return read_chunks_of(self.path, size)
        return read_chunks(self._source.read(self._size - 8 - size, size))

    def _unfolded(self, table: pa.Table, texts: Sequence[str], shared: frozenset[str]) -> pa.Table:
        """Give each row its own text, unless that takes too much room. Raises TraceError."""
        total = 0
        folded = [name for name in table.column_names if name in shared or name in texts]
        for chunk in (chunk for name in folded for chunk in table[name].chunks):
            if isinstance(chunk, pa.DictionaryArray) and _is_text(chunk.dictionary.type):
                if len(chunk) * chunk.dictionary.nbytes <= SMALL:
                    continue
                import pyarrow.compute as pc

                lengths = pc.binary_length(chunk.dictionary)
                if len(chunk) * (pc.max(lengths).as_py() or 0) > SMALL:
                    total += pc.sum(lengths.take(chunk.indices)).as_py() or 0
                    current().demand_decoded(total, self._size, str(self.path))
        for name in texts:
            plain = [
                decoded(chunk) if isinstance(chunk, pa.DictionaryArray) else chunk
                for chunk in table[name].chunks
            ]
            kind = table[name].type
            kind = kind.value_type if pa.types.is_dictionary(kind) else kind
            place = table.column_names.index(name)
            table = table.set_column(place, name, pa.chunked_array(plain, kind))
        return table

    def read_shared(self, group: int, columns: Iterable[str]) -> pa.Table:
        """Read all rows of a row group that several bodies or episodes share; raises as ``read``.

        Its columns are kept for the next one, as far as there is room.
        """
        names = list(dict.fromkeys(columns))
        by_name = {name: _COLUMNS.get((self._key, group, name)) for name in names}
        missing = [name for name, column in by_name.items() if column is None]
        if missing:
            table = self.read([group], missing)
            for name in missing:
                by_name[name] = table[name]
                _COLUMNS.put((self._key, group, name), table[name])
        return pa.table([by_name[name] for name in names], names)

    def _other_columns(self, read: list[str], wanted: list[str]) -> TraceError:
        name = next((name for name in wanted if read.count(name) != 1), wanted[0])
        if name not in read:
            return TraceError(
                str(self.path),
                f"the column {name!r} is missing; "
                f"there are {', '.join(sorted(self.footer.layout.types))}.",
                ", ".join(self.names),
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
