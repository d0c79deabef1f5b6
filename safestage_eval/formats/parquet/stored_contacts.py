"""The contacts of one stored episode: as a table by frame, or pair by pair without the others."""

from __future__ import annotations

from functools import cache, cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import (
    ContactTable,
    check_contact_order,
    check_finite,
    check_frame_range,
    check_geom_owner,
)
from safestage_eval.episode.contacts import Pair
from safestage_eval.errors import TraceError
from safestage_eval.formats.lazy_columns import StoredColumns

from .arrow_tables import CONTACT_VECTORS, XYZ
from .row_index import Names
from .stored_table import Block, StoredTable

KEYS = ("frame", "body1", "body2")
GEOMS = ("geom1", "geom2")
MOSTLY_READ = (
    "frame_index", "peak_force", *(f"{v}.{axis}" for v in ("normal", "force") for axis in XYZ)
)  # fmt: skip
"""Columns that nearly every rule asks for, of most pairs."""


class Source(NamedTuple):
    """Where the rows of an episode are, and what they are measured against.

    Attributes:
        table: ``contacts`` of the dataset.
        episode_index: key of the rows.
        rows: how many there must be.
        frames: T of the episode.
        body_index: name → index in the header.
        geom_owner: (G,) index of each geom's body.
        checked: raise on broken invariants.
        where: for messages.
        whole: the table was read ahead.
    """

    table: StoredTable
    episode_index: int
    rows: int
    frames: int
    body_index: dict[str, int]
    geom_owner: NDArray[np.int16]
    checked: bool
    where: str
    whole: bool = False

    def demand(self, errors: list[TraceError]) -> None:
        """Raise the first of the errors, when the episode is to be checked."""
        if self.checked and errors:
            raise errors[0]

    def complete(self, rows: int) -> None:
        """Raise TraceError where there are not as many rows as the episode says."""
        if rows != self.rows:
            raise TraceError(self.where, f"{self.table.path} has {rows} contacts, not {self.rows}")


class StoredContacts(StoredColumns, ContactTable):
    """A contact table that reads who touched when, and every quantity, separately.

    Where the file keeps each pair's rows together, one pair is read without the others.
    """

    _groups = (KEYS, GEOMS, ("position",), ("normal",), ("force",), ("peak_force",), ("depth",))

    def __init__(self, source: Source) -> None:
        super().__init__(_ByFrame(source))
        object.__setattr__(self, "_by_pair", _ByPair(source))

    _by_pair: _ByPair

    def __len__(self) -> int:
        """Number of contact rows."""
        return super().__len__() if self._by_pair.places is None else self._by_pair.rows

    def unordered(self, *columns: str) -> tuple[NDArray[Any], ...]:
        """Columns of all rows, in stored order."""
        if self._by_pair.places is None:
            return super().unordered(*columns)
        return self._by_pair.of_all(columns)

    @property
    def pairs(self) -> list[Pair]:
        """The pairs that touch, sorted."""
        places = self._by_pair.places
        return super().pairs if places is None else sorted(places)

    def of_pair(self, pair: Pair, *columns: str) -> tuple[NDArray[Any], ...]:
        """Columns of one pair, in the order of frames."""
        if self._by_pair.places is None:
            return super().of_pair(pair, *columns)
        return self._by_pair.columns(pair, columns)


class _ByPair:
    """Columns of one pair at a time, and components of vectors, each read once."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._known: dict[tuple[Pair, str], NDArray[Any]] = {}
        self._whole: dict[str, NDArray[Any]] = {}

    @cached_property
    def places(self) -> dict[Pair, Names] | None:
        """Pair → the names that its rows are found by; None where a pair's rows are not together.

        Raises:
            TraceError: contacts of what is no body, or not as many as the episode has.
        """
        source = self._source
        names_of: dict[Pair, Names] = {}
        spans, rows = [], 0
        for names, places in source.table.places(source.episode_index).items():
            first, second = (self._body(name, i + 1) for i, name in enumerate(names))
            source.demand(check_contact_order(np.array([first]), np.array([second]), source.where))
            names_of[first, second] = names
            for group, part in places:
                if not isinstance(part, slice):
                    return None
                spans.append((group, part.start, first, second))
                rows += part.stop - part.start
        spans.sort()
        stretches = 1 + sum(a[2:] != b[2:] for a, b in pairwise(spans)) if spans else 0
        if stretches != len(names_of):
            return None
        source.complete(rows)
        return names_of

    def _body(self, name: str | None, side: int) -> int:
        index = self._source.body_index
        if name is None or name not in index:
            raise TraceError(
                str(self._source.table.path),
                f"body{side} names {name!r}, which is no body.",
                ", ".join(index),
            )
        return index[name]

    @property
    def rows(self) -> int:
        """Return how many there are of all pairs."""
        return self._source.rows

    def of_all(self, names: tuple[str, ...]) -> tuple[NDArray[Any], ...]:
        """Return whole columns, as they are stored or pair by pair."""
        if not self._source.checked and self._sorted is not None:
            return tuple(map(self._sorted_column, names))
        source = self._source
        arrays = source.table.blocks(tuple(map(_block, names)), source.episode_index)
        return tuple(a[:, 0] if a.shape[1] == 1 else a for a in arrays)

    @cached_property
    def _sorted(self) -> tuple[NDArray[np.intp], dict[Pair, slice]] | None:
        """Order of the stored rows pair by pair as in the canonical table, and the place of each pair.

        None where the table was not read ahead, or pairs have other rows between theirs.
        """
        source, names_of = self._source, self.places or {}
        if not source.whole or not names_of:
            return None
        slots, frames = source.table.blocks(
            (Block(("slot",), np.dtype(np.int16)), _block("frame")), source.episode_index
        )
        spans, orders, at = dict[Pair, slice](), list[NDArray[np.intp]](), 0
        for pair in sorted(names_of):
            rows = source.table.span(source.episode_index, names_of[pair])
            if rows is None:
                return None
            frame, slot = frames[rows, 0], slots[rows, 0]
            order = np.argsort(frame, kind="stable")
            if (slot[1:] < slot[:-1]).any():
                order = np.lexsort((slot, frame))
            orders.append(rows.start + order)
            spans[pair] = slice(at, at + len(order))
            at += len(order)
        return np.concatenate(orders), spans

    def _sorted_column(self, name: str) -> NDArray[Any]:
        """Return a whole column pair by pair, or a component of a vector."""
        values = self._whole.get(name)
        if values is None:
            assert self._sorted is not None
            vector, _, axis = name.partition(".")
            if axis:
                return self._sorted_column(vector)[:, XYZ.index(axis)]
            source, block = self._source, _block(name)
            (stored,) = source.table.blocks((block,), source.episode_index)
            array = stored if len(block.names) > 1 else stored[:, 0]
            values = self._whole[name] = array.take(self._sorted[0], axis=0)
        return values

    def columns(self, pair: Pair, names: tuple[str, ...]) -> tuple[NDArray[Any], ...]:
        """Return columns of the table, and components of vectors; those not loaded yet are read at once."""
        if self._source.whole and not self._source.checked and self._sorted is not None:
            rows = self._sorted[1].get(pair, slice(0))
            return tuple(self._sorted_column(name)[rows] for name in names)
        arrays = [self._column(pair, name) for name in names]
        new = {name for name, array in zip(names, arrays, strict=True) if array is None}
        if new:
            whole = [n for n in names if n in new and ("." not in n or n[:-2] not in new)]
            self._known |= self._load(pair, tuple(dict.fromkeys(whole)))
            arrays = [self._column(pair, name) for name in names]
        return tuple(values for values in arrays if values is not None)

    def _column(self, pair: Pair, name: str) -> NDArray[Any] | None:
        """Return a column, or a component of a vector, if it is loaded."""
        values = self._known.get((pair, name))
        vector, _, axis = name.partition(".")
        if values is None and axis and (pair, vector) in self._known:
            values = self._known[pair, name] = self._known[pair, vector][:, XYZ.index(axis)]
        return values

    def _load(self, pair: Pair, names: tuple[str, ...]) -> dict[tuple[Pair, str], NDArray[Any]]:
        source, key = self._source, (self.places or {}).get(pair)
        blocks = tuple(_block(name) for name in names)
        arrays = (
            [np.empty((0, len(block.names)), block.dtype) for block in blocks]
            if key is None
            else source.table.blocks(blocks, source.episode_index, key)
        )
        columns = {}
        for name, array in zip(names, arrays, strict=True):
            values = array[:, 0] if array.shape[1] == 1 else array
            self._check(pair, name, values)
            columns[pair, name] = values
        return columns

    def _check(self, pair: Pair, name: str, values: NDArray[Any]) -> None:
        source = self._source
        if not source.checked:
            return
        if name == "frame":
            source.demand(check_frame_range(values, source.frames, source.where))
        elif name in GEOMS:
            side = name[-1]
            body = pair[int(side) - 1]
            source.demand(check_geom_owner(side, values, body, source.geom_owner, source.where))
        else:
            source.demand(check_finite(values, f"contact {name.partition('.')[0]}", source.where))


@cache
def _block(name: str) -> Block:
    """Return the stored columns that a column of the contact table is made of."""
    return Block(tuple(_stored_names(name)), np.dtype(_dtype(name)))


def _stored_names(name: str) -> list[str]:
    """Columns of the file that a column of the contact table is made of."""
    if name == "frame":
        return ["frame_index"]
    return [f"{name}.{axis}" for axis in XYZ] if name in CONTACT_VECTORS else [name]


def _dtype(name: str) -> Any:
    return np.int32 if name == "frame" else np.uint16 if name in GEOMS else np.float32


class _ByFrame:
    """Loads groups of columns of the whole table, in canonical order."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def __call__(self, columns: tuple[str, ...]) -> dict[str, NDArray[Any]]:
        source, (keys, _) = self._source, self._keys  # the keys come first: they tell the order
        if columns == KEYS:
            return keys
        loaded = {name: self._column(name) for name in columns}
        for name, values in loaded.items():
            if columns == GEOMS:
                side = name[-1]
                body = keys[f"body{side}"]
                source.demand(check_geom_owner(side, values, body, source.geom_owner, source.where))
            else:
                source.demand(check_finite(values, f"contact {name}", source.where))
        return loaded

    @cached_property
    def _keys(self) -> tuple[dict[str, NDArray[Any]], NDArray[np.intp]]:
        """Frames and bodies of the rows, and the order of the stored rows in the table."""
        source, table = self._source, self._source.table
        rows = table.rows(("frame_index", "slot", "body1", "body2"), source.episode_index)
        source.complete(len(rows))
        frame = table.numbers(rows, "frame_index", np.int32)
        slot = table.numbers(rows, "slot", np.int16)
        body1, body2 = (table.codes(rows, n, source.body_index) for n in ("body1", "body2"))
        order = _frame_order(frame, slot, body1, body2)
        keys = {"frame": frame, "body1": body1, "body2": body2}
        keys = {name: values.take(order) for name, values in keys.items()}
        source.demand(check_frame_range(keys["frame"], source.frames, source.where))
        source.demand(check_contact_order(keys["body1"], keys["body2"], source.where))
        return keys, order

    def _column(self, name: str) -> NDArray[Any]:
        source, stored = self._source, _stored_names(name)
        values = source.table.blocks((_block(name),), source.episode_index)[0]
        if len(values) != len(self._keys[1]):
            raise TraceError(
                source.where, f"{source.table.path} has {len(values)} values of {name}, not as many"
                f" as contacts: {len(self._keys[1])}",
            )  # fmt: skip
        # five times faster than values[order]
        return (values if len(stored) > 1 else values[:, 0]).take(self._keys[1], axis=0)


def _frame_order(
    frame: NDArray[np.int32],
    slot: NDArray[np.int16],
    body1: NDArray[np.int16],
    body2: NDArray[np.int16],
) -> NDArray[np.intp]:
    """Order of rows in the canonical table: by frame, pair, slot."""
    pair = body1.astype(np.int32) << 16 | body2
    step = np.diff(pair)
    if ((step < 0) | ((step == 0) & (np.diff(slot) < 0))).any():
        return np.lexsort((slot, pair, frame))
    # as we write it, by pair and slot: a stable sort by frame is all that is left
    small = frame.astype(np.uint16) if len(frame) and frame.max() < 1 << 16 else frame
    return np.argsort(small, kind="stable")
