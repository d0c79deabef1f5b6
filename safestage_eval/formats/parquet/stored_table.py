"""One Parquet table of a dataset, read by episode and body."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import DTypeLike, NDArray

from safestage_eval.errors import TraceError
from safestage_eval.formats.byte_source import LocalSource, SourceStream
from safestage_eval.formats.digests import KEYS, Seal, columns, crc, names_crc, numbers
from safestage_eval.formats.remote_path import source_of
from safestage_eval.formats.trace_files import regular

from . import arrow_values
from .arrow_tables import arrow_file, columns_of
from .parquet_columns import Block, Values, read_blocks
from .parquet_footer import Footer, by_pyarrow, read_footer, without_keys
from .small_table import read_records


@dataclass
class Known:
    """What the end of a file says, also as pyarrow wants it once it has read the file."""

    footer: Footer | None
    metadata: pq.FileMetaData | None = None


FOOTERS: dict[tuple[Path, Hashable], Known] = {}
"""By path and state of the file: shards hold many episodes, and their footers are large."""

_FOOTERS_KEPT = 12
"""Those of two shards: of 50 episodes, a shard's take some 6 MB."""

MOST_UNPACKED = 256
"""No byte of an LZ4 block stands for more: a file that promises more rows does not have them."""

WHOLE = "meta/episodes"
"""The table that is always read whole."""

LARGEST = 1 << 32
"""Bytes that the rows of one episode in a table may take: hours of a crowded scene."""


class StoredTable:
    """A table opened for reading. Nothing but its footer is read before ``rows``.

    Attributes:
        path: of the file.
        names: the columns that the format has for this table.
        columns: those that the file has.
        footer: what its end says; the same object as long as the file is the same.
    """

    def __init__(self, path: Path, table: str) -> None:
        self.path = path
        self._table, self.names = table, list(columns_of(table))
        try:
            regular(path)
        except (FileNotFoundError, NotADirectoryError):
            raise TraceError(
                str(path),
                f"the table {table!r} is missing.",
                fix="copy the dataset again, with all of its folders",
            ) from None
        except OSError as error:
            raise TraceError(str(path), f"cannot be read: {error.strerror or error}") from None
        try:
            self._source = source_of(path)
            key = path, self._source.state
            self._known = FOOTERS.get(key) or Known(None)
            if self._known.footer is None:
                self._known.footer = read_footer(self._source)
            if self._known.footer is None and table == WHOLE:
                self._known.footer = without_keys(self._file.metadata)
            elif self._known.footer is None:
                self._known.footer = by_pyarrow(self._file.metadata, self._source)
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:  # a name may be damaged
            raise _unreadable(path, error) from None
        FOOTERS[key] = self._known
        if len(FOOTERS) > _FOOTERS_KEPT:
            FOOTERS.pop(next(iter(FOOTERS)), None)
        self.footer = self._known.footer
        self._bodies: dict[int, dict[str, list[int]] | None] = {}
        self._seal: Seal | None = None
        self._digests: dict[int, dict[str, str]] = {}
        self._groups, self.columns = self.footer.groups, self.footer.columns

    def compare(self, episode: int, seal: Seal) -> None:
        """From now on compare what is read of an episode with the digests that were written.

        Raises TraceError where the rows are not as they were written, and the content differs.
        """
        told = seal.told.get(self._table) if isinstance(seal.told, dict) else None
        numbers, exact = self.groups(episode)
        lines = told if isinstance(told, list) and all(isinstance(x, str) for x in told) else []
        rows = [int(n) if n.isdigit() else -1 for n in (line.partition(":")[0] for line in lines)]
        if not exact or rows != [self._groups.rows(n) for n in numbers]:
            seal.differs(f"the table {self._table}")  # another library may have written it anew
            return
        names = columns(self._table)
        self._seal = seal
        for number, line in zip(numbers, lines, strict=True):
            crcs = line.partition(":")[2]
            self._digests[number] = {n: crcs[8 * i : 8 * i + 8] for i, n in enumerate(names)}
            about = [self._groups.single(number, key) for key in KEYS.get(self._table, ())]
            if None not in about and names_crc(about) != crcs[8 * len(names) :]:
                seal.differs(f"the names in {self._table}")

    def _compared(self, group: int, column: str, values: NDArray[Any]) -> None:
        """Raises TraceError for a column of a row group that is not as it was written."""
        told = self._digests.get(group, {}).pop(column, None)  # once is enough
        if told is not None and self._seal is not None and crc(values) != told:
            self._seal.differs(f"the column {column!r} of {self._table}")

    @cached_property
    def _file(self) -> pq.ParquetFile:
        """The file as pyarrow reads it, which takes long to open."""
        known = self._known
        local = isinstance(self._source, LocalSource)
        file = pq.ParquetFile(
            arrow_file(self.path) if local else pa.PythonFile(SourceStream(self._source), "r"),
            metadata=known.metadata,
            pre_buffer=not local,
            page_checksum_verification=True,
        )
        known.metadata = file.metadata
        return file

    def all(self, columns: Sequence[str]) -> pa.Table:
        """The columns, which must be there, for all rows. Raises TraceError on damaged bytes."""
        return self.read(range(len(self._groups)), columns)

    def rows(self, columns: Sequence[str], episode: int, body: str | None = None) -> pa.Table:
        """The columns for the rows of one episode (and of one body), in stored order.

        Raises:
            TraceError: a column is missing, or the bytes cannot be read.
        """
        groups, exact = self.groups(episode, body)
        keys = [] if exact else ["episode_index"] if body is None else ["episode_index", "body"]
        wanted = [*columns, *(key for key in keys if key not in columns)]
        self._demand(wanted)
        table = self.read(groups, wanted)
        if exact:
            begin = 0
            for group in groups if self._digests else ():
                part = table.slice(begin, self._groups.rows(group))
                begin += len(part)
                for name in columns:
                    if name in self._digests.get(group, {}):
                        self._compared(group, name, numbers(part[name]))
            return table
        import pyarrow.compute as pc  # takes a twentieth of what comes before a first verdict

        try:
            keep = pc.equal(table["episode_index"], episode)
            if body is not None:
                keep = pc.and_(keep, pc.equal(table["body"], body))
            return table.filter(keep)
        except pa.ArrowException:
            told = ", ".join(f"{key} holds {table[key].type}" for key in keys)
            raise TraceError(
                str(self.path), f"{told}.", "whole numbers for episodes, names for bodies"
            ) from None

    def records(
        self, columns: Sequence[str], episode: int | None = None
    ) -> list[dict[str, Any]] | None:
        """Rows, of one episode or all, as records; None where only ``rows`` or ``all`` can tell.

        Raises TraceError when the file cannot be read.
        """
        everything = range(len(self._groups)), True
        groups, exact = everything if episode is None else self.groups(episode)
        types = columns_of(self._table)
        kinds = {name: types[name].type for name in columns}
        again = episode is not None and len(groups) == 1
        found: list[dict[str, Any]] = []
        for group in groups if exact else ():
            try:
                part = read_records(self._source, self.footer, group, kinds, again=again)
            except OSError as error:
                raise _unreadable(self.path, error) from None
            if part is None or again:
                return part
            found += part
        return found if exact else None

    def values(
        self, columns: Sequence[str], dtype: DTypeLike, episode: int, body: str | None = None
    ) -> NDArray[Any]:
        """Columns of numbers as (rows, columns), of the rows that ``rows`` finds; raises as it does."""
        [found] = self.several((Block(tuple(columns), np.dtype(dtype)),), episode, body)
        return found.array

    def several(
        self, blocks: tuple[Block, ...], episode: int, body: str | None = None
    ) -> list[Values]:
        """Several such arrays, in one go where they are stored as usual."""
        groups, exact = self.groups(episode, body)
        if not exact:
            return [
                Values(self._stacked(self.rows(names, episode, body), names, dtype), False)
                for names, dtype in blocks
            ]
        if len(groups) == 1:
            return self.of_group(groups[0], blocks)
        none = [Values(np.empty((0, len(names)), dtype), False) for names, dtype in blocks]
        parts = [none, *(self.of_group(group, blocks) for group in groups)]
        return [
            Values(np.concatenate([values.array for values in part]), False)
            for part in zip(*parts, strict=True)
        ]

    def of_group(self, group: int, blocks: tuple[Block, ...]) -> list[Values]:
        """Arrays of all rows of a row group; raises as ``rows``."""
        width = sum(len(names) for names, _ in blocks)
        if 4 * self._groups.rows(group) * width <= MOST_UNPACKED * self._source.size:
            try:
                found = read_blocks(self._source, self.footer, group, blocks)
            except OSError as error:
                raise _unreadable(self.path, error) from None
            if found is not None:
                return self._all_compared(group, blocks, found)
        for names, _ in blocks:
            self._demand(names)
        found = [
            Values(self._stacked(self.read([group], names), names, dtype), False)
            for names, dtype in blocks
        ]
        return self._all_compared(group, blocks, found)

    def _all_compared(
        self, group: int, blocks: tuple[Block, ...], found: list[Values]
    ) -> list[Values]:
        left = self._digests.get(group)
        if left:
            for (names, _), values in zip(blocks, found, strict=True):
                for i, name in enumerate(names):
                    if name in left:
                        self._compared(group, name, values.array[:, i])
        return found

    def _stacked(self, table: pa.Table, columns: Sequence[str], dtype: DTypeLike) -> NDArray[Any]:
        out = np.empty((len(table), len(columns)), dtype)
        for i, column in enumerate(columns):
            out[:, i] = self.numbers(table, column, dtype)
        return out

    def _demand(self, columns: Sequence[str]) -> None:
        """Raise when a column is missing."""
        for name in columns:
            if name not in self.columns:
                raise TraceError(
                    str(self.path),
                    f"the column {name!r} is missing; there are {', '.join(sorted(self.columns))}.",
                    ", ".join(self.names),
                )

    def groups(self, episode: int, body: str | None = None) -> tuple[Sequence[int], bool]:
        """Numbers of the row groups that may hold rows of an episode (and of one body).

        In stored order, and whether they hold no other rows.
        """
        numbers, exact = self._groups.of_episode(episode)
        if body is None:
            return numbers, exact
        told = self._by_body(episode, numbers)
        if told is not None:
            return told.get(body, []), exact
        numbers = [number for number in numbers if self._groups[number].may_hold(body=body)]
        return numbers, exact and all(self._groups.single(n, "body") == body for n in numbers)

    def _by_body(self, episode: int, numbers: Sequence[int]) -> dict[str, list[int]] | None:
        """Row groups of each body; None where one holds several, or does not say."""
        if episode not in self._bodies:
            told: dict[str, list[int]] = {}
            for number in numbers:
                told.setdefault(self._groups.single(number, "body"), []).append(number)
            self._bodies[episode] = None if None in told else told
        return self._bodies[episode]

    def rows_of(self, group: int) -> int:
        """How many rows a row group has."""
        return self._groups.rows(group)

    def single(self, group: int, key: str) -> Any:
        """The only value of a key in a row group; None where there are several, or it does not say."""
        return self._groups.single(group, key)

    def read(self, groups: Sequence[int], columns: Sequence[str]) -> pa.Table:
        """All rows of some row groups. Raises TraceError on damaged bytes, and for too many rows."""
        rows = sum(self._groups.rows(group) for group in groups)
        if 4 * rows * len(columns) > LARGEST:
            raise TraceError(
                str(self.path),
                f"{rows:,} rows would have to be read at once.",
                f"{LARGEST // 4 // len(columns):,} rows of {len(columns)} columns",
                "write row groups of one episode each" if len(self._groups) == 1 else "",
            )
        try:
            table = self._file.read_row_groups(groups, columns=columns, use_threads=False)
        except (pa.ArrowException, OSError, UnicodeDecodeError, MemoryError) as error:
            raise _unreadable(self.path, error) from None
        twice = [name for name in columns if table.column_names.count(name) != 1]
        if twice:
            count = table.column_names.count(twice[0])
            raise TraceError(
                str(self.path), f"the column {twice[0]!r} is there {count} times.", "once"
            )
        short = [name for name in columns if len(table[name]) != rows]
        if short:
            raise TraceError(
                str(self.path),
                f"{len(table[short[0]])} values of {short[0]!r} in {rows} rows.",
                fix="copy the dataset again",
            )
        return table

    def numbers(self, table: pa.Table, column: str, dtype: DTypeLike) -> NDArray[Any]:
        """As ``arrow_values.numbers``."""
        return arrow_values.numbers(table, column, dtype, str(self.path))

    def lists(self, table: pa.Table, column: str, dtype: DTypeLike) -> NDArray[Any]:
        """As ``arrow_values.lists``."""
        return arrow_values.lists(table, column, dtype, str(self.path))

    def codes(self, table: pa.Table, column: str, index: dict[str, int]) -> NDArray[np.int16]:
        """As ``arrow_values.codes``."""
        return arrow_values.codes(table, column, index, str(self.path))


def _unreadable(path: Path, error: Exception) -> TraceError:
    try:
        size = path.stat().st_size
    except OSError:
        return TraceError(str(path), f"cannot be read: {error}")
    return TraceError(
        str(path),
        f"not a whole Parquet file ({size} bytes): {(str(error).strip() or type(error).__name__).splitlines()[0]}.",
        "a file that ends with its footer",
        "copy it again, or record the episode again",
    )
