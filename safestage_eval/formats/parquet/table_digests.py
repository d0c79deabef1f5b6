"""CRC-32 of the columns of a table: noted when an episode is written, compared when it is read.

An episode's rows in a table are cut into segments, the row groups that were written. Each has a
line: its number of rows, the CRCs of its columns, and one of the names that its rows are about. The
lines go by the order of the rows alone, so they hold as well where another library has written the
same rows into other row groups.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from itertools import accumulate
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from safestage_eval.formats.checksum import crc32
from safestage_eval.formats.digests import Seal, crc

from .arrow_tables import TABLES
from .arrow_values import NUMBERS, flat_values, raw_values
from .row_index import Names, Run, runs_of

DIGESTED_TABLES = ("bodies", "contacts", "frames", "channels")
"""Tables of which each column has a digest; simulator states are not judged."""

DIGESTED_NAMES = ("bodies", "contacts")
"""Tables whose lines end with a digest of the names that the rows are about."""


@cache
def digested_columns(table: str) -> tuple[str, ...]:
    """Return the columns of numbers that have a digest, in the table's order."""
    return tuple(
        name
        for name, column in TABLES[table].items()
        if name != "episode_index" and column.type not in ("dictionary", "string")
    )


def flat_numbers(column: pa.ChunkedArray) -> NDArray[Any]:
    """Return the numbers of a column, those of lists one after the other."""
    if column.num_chunks == 1 and column.type.id in NUMBERS and not column.null_count:
        return np.from_dlpack(column.chunk(0))  # as most are
    lists = pa.types.is_list(column.type) or pa.types.is_large_list(column.type)
    some = [chunk for chunk in column.chunks if len(chunk)]
    parts = [flat_values(chunk) if lists else raw_values(chunk) for chunk in some]
    if not parts:
        return np.zeros(0, np.float32)
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def digest_line(table: str, group: pa.Table, runs: Sequence[Run]) -> str:
    """Return the digest line of a row group."""
    crcs = "".join(crc(flat_numbers(group[name])) for name in digested_columns(table))
    spans = [(run.names, run.rows) for run in runs] if table in DIGESTED_NAMES else []
    return f"{len(group)}:{crcs}{names_crc(spans)}"


def names_crc(spans: Sequence[tuple[Names, int]]) -> str:
    """Return the CRC-32 of the names that rows are about: one entry's names, or names and rows of each."""
    if len(spans) == 1:
        return _names_crc(spans[0][0])
    return _json_crc([[*names, rows] for names, rows in spans])


@lru_cache(maxsize=4096)
def _names_crc(names: Names) -> str:
    return _json_crc([*names])


def _json_crc(value: object) -> str:
    return f"{crc32(json.dumps(value).encode()):08x}"


class Segments:
    """The lines of an episode's rows in a table, compared column by column as they are read."""

    def __init__(self, table: str, lines: object, seal: Seal) -> None:
        """Parse digest lines; without valid ones there are no segments."""
        self._table, self._seal = table, seal
        sound = isinstance(lines, list) and all(isinstance(line, str) for line in lines)
        parts = [line.partition(":") for line in lines] if isinstance(lines, list) and sound else []
        rows = [int(n) if n.isdecimal() else -1 for n, _, _ in parts]
        self.starts = [0, *accumulate(rows)]
        names = digested_columns(table)
        width = 8 * len(names)
        self._names = [crcs[width:] for _, _, crcs in parts]
        self._left = [
            {name: crcs[8 * i : 8 * i + 8] for i, name in enumerate(names)} for _, _, crcs in parts
        ]

    @property
    def rows(self) -> int:
        """Number of rows of all segments; −1 where the lines do not say."""
        return self.starts[-1] if sorted(self.starts) == self.starts else -1

    def differ(self) -> None:
        """Report rows that are not those that were written. Raises TraceError if their content differs."""
        self._seal.differs(f"the table {self._table}")

    def compare_names(self, runs: Sequence[tuple[Names, int]], *, stated: bool) -> None:
        """Compare the names that rows are about with their digests.

        Args:
            runs: names and rows of all rows of the episode, in order.
            stated: by the file's own index; files without one have no digest of several names.
        """
        if self._table not in DIGESTED_NAMES:
            return
        ends = list(accumulate(rows for _, rows in runs))
        for number, stated_crc in enumerate(self._names):
            first, last = self.starts[number : number + 2]
            spans, at = [], bisect_right(ends, first)
            while at < len(runs) and ends[at] - runs[at][1] < last:
                begin = max(ends[at] - runs[at][1], first)
                spans.append((runs[at][0], min(ends[at], last) - begin))
                at += 1
            wanted = {names_crc(spans)} if stated or len(spans) == 1 else {names_crc(spans), _OLD}
            if stated_crc not in wanted:
                self._seal.differs(f"the names in {self._table}")

    def compare(
        self,
        first: int,
        rows: int,
        columns: Mapping[str, NDArray[Any]],
        read: Callable[[str, int, int], NDArray[Any]],
    ) -> None:
        """Compare the digests of all segments of which consecutive rows were read, column by column.

        Args:
            first: number of the first row that was read, among those of the episode.
            rows: how many were read.
            columns: their numbers, those of lists one after the other.
            read: (name, begin, end) → numbers of the episode's rows begin to end − 1.

        Raises:
            TraceError: a digest differs, and so does the content.
        """
        number, last = bisect_right(self.starts, first) - 1, first + rows
        while 0 <= number < len(self._left) and self.starts[number] < last:
            begin, end = self.starts[number : number + 2]
            left = self._left[number]
            for name, values in columns.items():
                stated = left.pop(name, None)  # once is enough
                if stated is None:
                    continue
                numbers = values
                if first <= begin and end <= last and len(values) == rows:
                    numbers = values[begin - first : end - first]
                elif (begin, end) != (first, last):
                    numbers = read(name, begin, end)
                if crc(numbers) != stated:
                    self._seal.differs(f"the column {name!r} of {self._table}")
            number += 1


_OLD = names_crc([])
"""Digest that files without an index have for a segment with several names."""


def with_digests(
    table: str, groups: Iterator[pa.Table], digests: dict[str, list[str]]
) -> Iterator[tuple[pa.Table, list[Run]]]:
    """Yield each row group with its runs; collect their digest lines in ``digests``."""
    lines = digests.setdefault(table, []) if table in DIGESTED_TABLES else None
    for group in groups:
        runs = runs_of(table, group)
        if lines is not None and len(group):
            lines.append(digest_line(table, group, runs))
        yield group, runs
