"""One table of a dataset, read by episode and by the bodies that rows are about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from safestage_eval.formats.digests import Seal

from . import arrow_values
from .row_index import EPISODE, NAME_COLUMNS, Members, Names, Place, Rows, runs_of, runs_to_members
from .table_digests import Segments, digested_columns, flat_numbers
from .table_file import TableFile


class Block(NamedTuple):
    """Columns that become one array.

    Attributes:
        names: of the C columns.
        dtype: of the array.
    """

    names: tuple[str, ...]
    dtype: np.dtype[Any]


_AHEAD_BYTES = 64 << 20
"""Most bytes of an episode's columns in a table that are read at once, before they are asked for."""


class _Span(NamedTuple):
    """Rows of an episode in a row group, and where they begin among all rows of the episode."""

    place: Place
    first: int


class _Stretch(NamedTuple):
    """Consecutive rows of an episode: the first one, its place in what was read, and how many."""

    first: int
    at: int
    rows: int


_Numbers = Mapping[str, NDArray[Any]]
"""The numbers of columns, as they are stored."""


class StoredTable(TableFile):
    """A table of which the rows of one episode, and of one body or pair in it, are read alone."""

    def __init__(self, path: Path, table: str) -> None:
        """Open it; raises TraceError where there is no file, or none that can be read."""
        super().__init__(path, table)
        self._table = table
        self._names = NAME_COLUMNS.get(table, ())
        self._places: dict[int, dict[Names, list[Place]]] = {}
        self._spans: dict[int, dict[int, _Span]] = {}
        self._segments: dict[int, Segments] = {}
        self._ahead: dict[int, _Numbers] = {}
        self._arrays_ahead: dict[tuple[int, Block], NDArray[Any]] = {}

    def compare(self, episode: int, seal: Seal) -> None:
        """Compare from now on what is read of an episode with its stated digests.

        Raises TraceError where the rows are not as they were written, and the content differs.
        """
        lines = seal.digests.get(self._table) if isinstance(seal.digests, dict) else None
        segments = Segments(self._table, lines, seal)
        spans = self._spans_of(episode)
        in_order = all(isinstance(span.place.rows, slice) for span in spans.values())
        if not in_order or segments.rows != sum(_count(span.place.rows) for span in spans.values()):
            segments.differ()
            return
        self._segments[episode] = segments
        if all(self.footer.index.members[span.place.group] is not None for span in spans.values()):
            self.places(episode)

    def read_ahead(self, episode: int, columns: Sequence[str] | None = None) -> None:
        """Read columns of an episode at once, all of numbers if None, because they will be used.

        That takes half as long as many small reads; nothing is done where it would take much memory.

        Raises:
            TraceError: the bytes cannot be read.
        """
        places = [span.place for span in self._spans_of(episode).values()]
        names = digested_columns(self._table) if columns is None else columns
        names = [name for name in names if name in self.footer.layout.types]
        rows = sum(_count(place.rows) for place in places)
        if names and 4 * rows * len(names) <= _AHEAD_BYTES:
            self._ahead[episode] = _numbers(self._read_places(names, places))

    def all(self, columns: Sequence[str]) -> pa.Table:
        """Read columns for all rows. Raises TraceError for a missing column or damaged bytes."""
        return self.read(range(len(self.footer.index.rows)), columns)

    def rows(self, columns: Sequence[str], episode: int, body: str | None = None) -> pa.Table:
        """Read columns for the rows of one episode (and of one body), in stored order.

        Raises:
            TraceError: a column is missing, or the bytes cannot be read.
        """
        if body is None:
            places = [span.place for span in self._spans_of(episode).values()]
            if episode in self._segments and set(columns) & set(self._names):
                self.places(episode)
        else:
            places = self.places(episode).get((body,), [])
        table = self._read_places(columns, places)
        if episode in self._segments:
            digested = [name for name in columns if name in digested_columns(self._table)]
            self._compare(episode, places, _numbers(table.select(digested)))
        return table

    def blocks(
        self, blocks: tuple[Block, ...], episode: int, names: Names | None = None
    ) -> list[NDArray[Any]]:
        """Read columns of numbers for the rows of one episode (and of one body or pair), in stored order.

        Returns:
            (N, C) of each block.

        Raises:
            TraceError: a column is missing, or the bytes cannot be read.
        """
        if names is None:
            places = [span.place for span in self._spans_of(episode).values()]
        else:
            places = self.places(episode).get(names, [])
        columns = list(chain.from_iterable(block.names for block in blocks))
        ahead = self._ahead.get(episode)
        if ahead is not None and ahead.keys() >= set(columns):
            stretches = self._stretches(episode, places)
            if len(stretches) == 1:
                first, _, count = stretches[0]
                rows = slice(first, first + count)
                if episode in self._segments:
                    self._compare(episode, places, {name: ahead[name][rows] for name in columns})
                return [self._array_ahead(episode, block)[rows] for block in blocks]
        numbers = _numbers(self._read_places(columns, places))
        if episode in self._segments:
            self._compare(episode, places, numbers)
        return [self._stacked(numbers, block) for block in blocks]

    def places(self, episode: int) -> Mapping[Names, list[Place]]:
        """Return the places of the rows of each body or pair of an episode, in stored order.

        Reads the columns of names, where the file does not say without.

        Raises:
            TraceError: those cannot be read, or hold no names.
        """
        if episode not in self._places:
            by_names: dict[Names, list[Place]] = {}
            for group in self.footer.index.groups_of(episode):
                for (whose, names), rows in self._members(group).items():
                    if whose == episode:
                        by_names.setdefault(names, []).append(Place(group, rows))
            self._places[episode] = by_names
            if episode in self._segments:
                self._compare_names(episode)
        return self._places[episode]

    def span(self, episode: int, names: Names) -> slice | None:
        """Return the rows of a body or pair among those of an episode; None if they are scattered."""
        stretches = self._stretches(episode, self.places(episode).get(names, []))
        if len(stretches) != 1:
            return None
        return slice(stretches[0].first, stretches[0].first + stretches[0].rows)

    def codes(self, table: pa.Table, column: str, index: dict[str, int]) -> NDArray[np.int16]:
        """See ``arrow_values.codes``."""
        return arrow_values.codes(table, column, index, str(self.path))

    def numbers(self, table: pa.Table, column: str, dtype: Any) -> NDArray[Any]:
        """See ``arrow_values.numbers``."""
        return arrow_values.numbers(table, column, dtype, str(self.path))

    def lists(self, table: pa.Table, column: str, dtype: Any) -> NDArray[Any]:
        """See ``arrow_values.lists``."""
        return arrow_values.lists(table, column, dtype, str(self.path))

    def _spans_of(self, episode: int) -> dict[int, _Span]:
        """Row group → the rows of an episode in it, in stored order."""
        if episode not in self._spans:
            spans, first = dict[int, _Span](), 0
            for group in self.footer.index.groups_of(episode):
                rows = self._episode_rows(group, episode)
                if count := _count(rows):
                    spans[group] = _Span(Place(group, rows), first)
                    first += count
            self._spans[episode] = spans
        return self._spans[episode]

    def _episode_rows(self, group: int, episode: int) -> Rows:
        index = self.footer.index
        if index.members[group] is None and index.episodes[group] == (episode, episode):
            return slice(0, index.rows[group])
        return _union([rows for key, rows in self._members(group).items() if key[0] == episode])

    def _members(self, group: int) -> Members:
        """Return whose rows a row group holds; reads its key columns where the footer does not say."""
        index = self.footer.index
        members = index.members[group]
        if members is None:
            table = self.read([group], (EPISODE, *self._names))
            runs = runs_of(self._table, table, str(self.path))
            members = index.members[group] = runs_to_members(runs)
        return members

    def _array_ahead(self, episode: int, block: Block) -> NDArray[Any]:
        """(N, C) numbers of a block in all rows that were read ahead, made once."""
        key = episode, block
        if key not in self._arrays_ahead:
            self._arrays_ahead[key] = self._stacked(self._ahead[episode], block)
        return self._arrays_ahead[key]

    def _read_places(self, columns: Sequence[str], places: Sequence[Place]) -> pa.Table:
        """The rows at some places, one after the other."""
        counts = self.footer.index.rows
        if all(_count(place.rows) == counts[place.group] for place in places):
            return self.read([place.group for place in places], columns)
        parts = []
        for group, rows in places:
            table = self.read_shared(group, columns)
            if isinstance(rows, slice):
                parts.append(table.slice(rows.start, rows.stop - rows.start))
            else:
                parts.append(table.take(pa.array(rows)))
        return pa.concat_tables(parts)

    def _stacked(self, columns: _Numbers, block: Block) -> NDArray[Any]:
        """(N, C) numbers of a block, whatever type its columns have. Raises TraceError for no numbers."""
        names, dtype = block
        for name in names:
            values, held = columns[name], self.footer.layout.types[name]
            arrow_values.check_numbers(values, name, held, dtype, str(self.path))
        out = np.empty((len(columns[names[0]]), len(names)), dtype)
        for i, name in enumerate(names):
            out[:, i] = columns[name]
        return out

    def _compare(self, episode: int, places: Sequence[Place], columns: _Numbers) -> None:
        """Compare what was read of the rows at some places with its digests."""
        segments = self._segments[episode]
        read = partial(self._column, episode)
        stretches = self._stretches(episode, places)
        for first, at, rows in stretches:
            part = (
                columns
                if len(stretches) == 1
                else {name: values[at : at + rows] for name, values in columns.items()}
            )
            segments.compare(first, rows, part, read)

    def _stretches(self, episode: int, places: Sequence[Place]) -> list[_Stretch]:
        """Return where rows at some places are among all rows of the episode; [] if they are scattered."""
        spans = self._spans_of(episode)
        stretches: list[_Stretch] = []
        at = 0
        for group, rows in places:
            span = spans[group]
            if not isinstance(rows, slice) or not isinstance(span.place.rows, slice):
                return []
            first = span.first + rows.start - span.place.rows.start
            count = rows.stop - rows.start
            if stretches and stretches[-1].first + stretches[-1].rows == first:
                stretches[-1] = stretches[-1]._replace(rows=stretches[-1].rows + count)
            else:
                stretches.append(_Stretch(first, at, count))
            at += count
        return stretches

    def _compare_names(self, episode: int) -> None:
        """Compare the names that the rows of an episode are about with their digests."""
        parts = [
            (place.group, place.rows, names)
            for names, places in self._places[episode].items()
            for place in places
        ]
        runs = [(g, rows.start, rows.stop, n) for g, rows, n in parts if isinstance(rows, slice)]
        if len(runs) < len(parts):  # not in the order in which they were written
            self._segments.pop(episode).differ()
            return
        stretches = [(names, stop - start) for _, start, stop, names in sorted(runs)]
        self._segments[episode].compare_names(stretches, stated=self.footer.index.stated)

    def _column(self, episode: int, name: str, begin: int, end: int) -> NDArray[Any]:
        """Read the numbers of rows ``begin`` to ``end`` − 1 of an episode in a column."""
        ahead = self._ahead.get(episode, {}).get(name)
        if ahead is not None:
            return ahead[begin:end]
        parts = []
        for place, first in self._spans_of(episode).values():
            assert isinstance(place.rows, slice)
            start, stop = max(begin - first, 0), min(end - first, _count(place.rows))
            if start < stop:
                column = self.read_shared(place.group, [name])[name]
                parts.append(flat_numbers(column.slice(place.rows.start + start, stop - start)))
        return np.concatenate(parts) if parts else np.zeros(0)


def _numbers(table: pa.Table) -> dict[str, NDArray[Any]]:
    return {
        name: flat_numbers(column)
        for name, column in zip(table.column_names, table.itercolumns(), strict=True)
    }


def _count(rows: Rows) -> int:
    return rows.stop - rows.start if isinstance(rows, slice) else len(rows)


def _union(parts: Sequence[Rows]) -> Rows:
    """The rows of all parts, ascending."""
    spans = sorted((p.start, p.stop) for p in parts if isinstance(p, slice))
    joined = all(a[1] == b[0] for a, b in pairwise(spans))
    if len(spans) == len(parts) and joined:
        return slice(spans[0][0], spans[-1][1]) if spans else slice(0, 0)
    rows = [np.arange(p.start, p.stop) if isinstance(p, slice) else p for p in parts]
    every = np.sort(np.concatenate(rows))
    if every[-1] - every[0] + 1 == len(every):
        return slice(int(every[0]), int(every[-1]) + 1)
    return every.astype(np.intp, copy=False)
