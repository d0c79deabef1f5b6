"""One Parquet table of a dataset, read by episode and body."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import DTypeLike, NDArray

from safestage_eval.errors import TraceError

from .arrow_tables import schema

KEYS = ("episode_index", "body", "body1", "body2")
"""Columns that rows are looked up by."""


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


class Footer(NamedTuple):
    """What the end of a file says: its metadata, row groups, and the names of its columns."""

    metadata: pq.FileMetaData
    groups: tuple[Group, ...]
    columns: frozenset[str]

    @classmethod
    def of(cls, metadata: pq.FileMetaData) -> Footer:
        """Read from metadata; raises UnicodeDecodeError for names that are no text."""
        names = [metadata.schema.column(i).path for i in range(metadata.num_columns)]
        keys = {key: names.index(key) for key in KEYS if key in names}
        groups = []
        for i in range(metadata.num_row_groups):
            group, limits = metadata.row_group(i), {}
            for key, place in keys.items():
                found = group.column(place).statistics
                if found is not None and found.has_min_max and not found.null_count:
                    limits[key] = found.min, found.max
            groups.append(Group(i, group.num_rows, limits))
        columns = frozenset(metadata.schema.to_arrow_schema().names)
        return cls(metadata, tuple(groups), columns)


FOOTERS: dict[tuple[Path, int, int], Footer] = {}
"""By path, time of change and size: shards hold many episodes, and their footers are large."""

_FOOTERS_KEPT = 32


class StoredTable:
    """A table opened for reading. Nothing but its footer is read before ``rows``.

    Attributes:
        path: of the file.
        names: the columns that the format has for this table.
        columns: those that the file has.
    """

    def __init__(self, path: Path, table: str) -> None:
        self.path = path
        self.names = schema(table).names
        try:
            stat = path.stat()
        except OSError:
            raise TraceError(
                str(path),
                f"the table {table!r} is missing.",
                fix="copy the dataset again, with all of its folders",
            ) from None
        key = path, stat.st_mtime_ns, stat.st_size
        known = FOOTERS.get(key)
        try:
            self._file = pq.ParquetFile(
                path,
                metadata=known.metadata if known else None,
                pre_buffer=False,
                page_checksum_verification=True,
            )
            if known is None:
                known = FOOTERS[key] = Footer.of(self._file.metadata)
                if len(FOOTERS) > _FOOTERS_KEPT:
                    FOOTERS.pop(next(iter(FOOTERS)), None)
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:  # a name may be damaged
            raise _unreadable(path, error) from None
        self._groups, self.columns = known.groups, known.columns

    def all(self, columns: Sequence[str]) -> pa.Table:
        """The columns, which must be there, for all rows. Raises TraceError on damaged bytes."""
        return self.read(range(len(self._groups)), columns)

    def rows(self, columns: Sequence[str], episode: int, body: str | None = None) -> pa.Table:
        """The columns for the rows of one episode (and of one body), in stored order.

        Raises:
            TraceError: a column is missing, or the bytes cannot be read.
        """
        groups = self.groups(episode, body)
        exact = all(group.only(episode_index=episode, body=body) for group in groups)
        keys = [] if exact else ["episode_index"] if body is None else ["episode_index", "body"]
        wanted = [*columns, *(key for key in keys if key not in columns)]
        for name in wanted:
            if name not in self.columns:
                raise TraceError(
                    str(self.path),
                    f"the column {name!r} is missing; there are {', '.join(sorted(self.columns))}.",
                    ", ".join(self.names),
                )
        table = self.read([group.number for group in groups], wanted)
        if exact:
            return table
        keep = pc.equal(table["episode_index"], episode)
        if body is not None:
            keep = pc.and_(keep, pc.equal(table["body"], body))
        return table.filter(keep)

    def groups(self, episode: int, body: str | None = None) -> list[Group]:
        """The row groups that may hold rows of an episode (and of one body), in stored order."""
        return [g for g in self._groups if g.may_hold(episode_index=episode, body=body)]

    def read(self, groups: Sequence[int], columns: Sequence[str]) -> pa.Table:
        """All rows of some row groups. Raises TraceError on damaged bytes."""
        try:
            return self._file.read_row_groups(groups, columns=columns, use_threads=False)
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            raise _unreadable(self.path, error) from None

    def numbers(self, table: pa.Table, column: str, dtype: DTypeLike) -> NDArray[Any]:
        """A column of numbers as (rows,) array of dtype; raises TraceError when it is none."""
        parts = [_values(chunk) for chunk in table[column].chunks] or [np.zeros(0, dtype)]
        values = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if values.dtype.kind not in "iuf":
            raise TraceError(
                str(self.path), f"the column {column!r} holds {table[column].type}.", "numbers"
            )
        if values.dtype == dtype:
            return values
        if np.dtype(dtype).kind in "iu" and values.dtype.kind == "f":
            raise TraceError(
                str(self.path), f"the column {column!r} has gaps or fractions.", f"{dtype}"
            )
        return values.astype(dtype)

    def lists(self, table: pa.Table, column: str, dtype: DTypeLike) -> NDArray[Any]:
        """A column of lists of equal length as (rows, width); raises TraceError when they are not."""
        chunks = [chunk for chunk in table[column].chunks if len(chunk)]
        widths = {int(w) for c in chunks for w in np.unique(np.diff(_values(c.offsets)))}
        if len(widths) > 1 or any(chunk.null_count for chunk in chunks):
            raise TraceError(
                str(self.path),
                f"the rows of {column!r} differ in length: {sorted(widths)}.",
                "as many values in every frame; empty lists where there is nothing",
            )
        width = widths.pop() if widths else 0
        flat = [_values(chunk.flatten()) for chunk in chunks]
        values = np.concatenate(flat) if flat else np.zeros(0)
        return np.asarray(values, dtype).reshape(len(table), width)

    def codes(self, table: pa.Table, column: str, index: dict[str, int]) -> NDArray[np.int16]:
        """A column of names as (rows,) numbers; raises TraceError for a name not in the index."""
        found = []
        for chunk in table[column].chunks:
            words = chunk if isinstance(chunk, pa.DictionaryArray) else chunk.dictionary_encode()
            names = words.dictionary.to_pylist()
            used = _values(words.indices)
            if words.null_count:
                raise TraceError(str(self.path), f"{column} is empty in {words.null_count} rows")
            codes = np.array([index.get(name, -1) for name in names], np.int16)[used]
            if len(codes) and codes.min() < 0:
                stranger = names[used[np.argmin(codes)]]
                raise TraceError(
                    str(self.path),
                    f"{column} names {stranger!r}, which is no body.",
                    ", ".join(index),
                )
            found.append(codes)
        return np.concatenate(found) if found else np.zeros(0, np.int16)


def _values(array: pa.Array) -> NDArray[Any]:
    """The values of an array; numbers without gaps are not copied.

    ``Array.to_numpy`` imports pandas, which takes 50 MB and 0.3 s.
    """
    kind = array.type
    if (pa.types.is_integer(kind) or pa.types.is_floating(kind)) and not array.null_count:
        return np.from_dlpack(array)
    return np.asarray(array.to_numpy(zero_copy_only=False))


def _unreadable(path: Path, error: Exception) -> TraceError:
    try:
        size = path.stat().st_size
    except OSError:
        size = 0
    return TraceError(
        str(path),
        f"not a whole Parquet file ({size} bytes): {str(error).strip().splitlines()[0]}.",
        "a file that ends with its footer",
        "copy it again, or record the episode again",
    )
