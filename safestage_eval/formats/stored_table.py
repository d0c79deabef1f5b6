"""One Parquet table of a dataset, read by episode and body."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import DTypeLike, NDArray

from safestage_eval.errors import TraceError

from .arrow_tables import schema


class _Group(NamedTuple):
    """A row group and the keys it may hold; None where the file does not say."""

    number: int
    episodes: tuple[int, int] | None
    bodies: tuple[str, str] | None

    def may_hold(self, episode: int, body: str | None) -> bool:
        return (self.episodes is None or self.episodes[0] <= episode <= self.episodes[1]) and (
            body is None or self.bodies is None or self.bodies[0] <= body <= self.bodies[1]
        )

    def holds_only(self, episode: int, body: str | None) -> bool:
        return self.episodes == (episode, episode) and (body is None or self.bodies == (body, body))


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
        try:
            footer, self._groups = _footer(path, stat.st_mtime_ns, stat.st_size)
            self._file = pq.ParquetFile(
                path, metadata=footer, pre_buffer=False, page_checksum_verification=True
            )
        except (pa.ArrowException, OSError) as error:
            raise _unreadable(path, error) from None
        self.columns = frozenset(footer.schema.to_arrow_schema().names)

    def all(self, columns: Sequence[str]) -> pa.Table:
        """The columns, which must be there, for all rows. Raises TraceError on damaged bytes."""
        return self._read(range(len(self._groups)), columns)

    def rows(self, columns: Sequence[str], episode: int, body: str | None = None) -> pa.Table:
        """The columns for the rows of one episode (and of one body), in stored order.

        Raises:
            TraceError: a column is missing, or the bytes cannot be read.
        """
        groups = [group for group in self._groups if group.may_hold(episode, body)]
        exact = all(group.holds_only(episode, body) for group in groups)
        keys = [] if exact else ["episode_index"] if body is None else ["episode_index", "body"]
        wanted = [*columns, *(key for key in keys if key not in columns)]
        for name in wanted:
            if name not in self.columns:
                raise TraceError(
                    str(self.path),
                    f"the column {name!r} is missing; there are {', '.join(sorted(self.columns))}.",
                    ", ".join(self.names),
                )
        table = self._read([group.number for group in groups], wanted)
        if exact:
            return table
        keep = pc.equal(table["episode_index"], episode)
        if body is not None:
            keep = pc.and_(keep, pc.equal(table["body"], body))
        return table.filter(keep)

    def _read(self, groups: Sequence[int], columns: Sequence[str]) -> pa.Table:
        try:
            return self._file.read_row_groups(groups, columns=columns, use_threads=False)
        except (pa.ArrowException, OSError) as error:
            raise _unreadable(self.path, error) from None

    def numbers(self, table: pa.Table, column: str, dtype: DTypeLike) -> NDArray[Any]:
        """A column of numbers as (rows,) array of dtype; raises TraceError when it is none."""
        values: NDArray[Any] = table[column].to_numpy()
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
        widths = {int(w) for c in chunks for w in np.unique(np.diff(c.offsets.to_numpy()))}
        if len(widths) > 1 or any(chunk.null_count for chunk in chunks):
            raise TraceError(
                str(self.path),
                f"the rows of {column!r} differ in length: {sorted(widths)}.",
                "as many values in every frame; empty lists where there is nothing",
            )
        width = widths.pop() if widths else 0
        flat = [np.asarray(chunk.flatten().to_numpy(zero_copy_only=False)) for chunk in chunks]
        values = np.concatenate(flat) if flat else np.zeros(0)
        return np.asarray(values, dtype).reshape(len(table), width)

    def codes(self, table: pa.Table, column: str, index: dict[str, int]) -> NDArray[np.int16]:
        """A column of names as (rows,) numbers; raises TraceError for a name not in the index."""
        found = []
        for chunk in table[column].chunks:
            words = chunk if isinstance(chunk, pa.DictionaryArray) else chunk.dictionary_encode()
            names = words.dictionary.to_pylist()
            used = words.indices.to_numpy(zero_copy_only=False)
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


@lru_cache(maxsize=32)
def _footer(path: Path, changed: int, size: int) -> tuple[pq.FileMetaData, tuple[_Group, ...]]:
    """Footer and row groups of a file, kept as long as it does not change (shards are large)."""
    del changed, size
    footer = pq.read_metadata(path)
    names = [footer.schema.column(i).path for i in range(footer.num_columns)]
    places = [names.index(key) if key in names else None for key in ("episode_index", "body")]

    def limits(group: int, column: int | None) -> Any:
        if column is None:
            return None
        statistics = footer.row_group(group).column(column).statistics
        if statistics is None or not statistics.has_min_max or statistics.null_count:
            return None
        return statistics.min, statistics.max

    return footer, tuple(
        _Group(i, limits(i, places[0]), limits(i, places[1])) for i in range(footer.num_row_groups)
    )


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
