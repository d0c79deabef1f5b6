"""A contact table over packed points that are kept as they came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, check_contacts
from safestage_eval.episode.contacts import Pair
from safestage_eval.formats.contact_points import POINT, GeomNames, table
from safestage_eval.formats.lazy_columns import StoredColumns

from . import kernel_choice

_WORDS = POINT.itemsize // 4

_PLACES = {
    name: (offset // 4, dtype.itemsize // 4)
    for name, (dtype, offset, *_) in (POINT.fields or {}).items()
}
"""Field of POINT → its first word, and how many it has."""

_MOST_KEYS = 1 << 22
"""Pairs of geoms up to which each has a number of its own."""


class Points(NamedTuple):
    """Contacts of consecutive frames.

    Attributes:
        points: (C,) POINT.
        counts: (T,) how many each frame has.
        geoms: (C,) both geoms of each in one number, the first in its lower half.
        finite: all numbers are finite, for sure.
    """

    points: NDArray[Any]
    counts: NDArray[np.int64]
    geoms: NDArray[np.uint32]
    finite: bool


def contact_table(given: Points, names: GeomNames, where: str, checked: bool) -> ContactTable:
    """The canonical table of points.

    Points in the table's order are not copied before they are asked for. ``checked``: raise on
    broken invariants.

    Raises:
        TraceError: a geom index that no body has, or values that are not finite.
    """
    order = _sorted(given, names)
    rows = (
        table(given.points, given.counts, names)
        if order is None
        else PackedContacts(given, names.owner, order)
    )
    if checked and (order is None or not given.finite):
        errors = check_contacts(rows, names.owner, len(given.counts), where)
        if errors:
            raise errors[0]
    return rows


class Order(NamedTuple):
    """Points sorted by pair of bodies.

    Attributes:
        spans: pair → where its rows begin and end in ``rows``.
        rows: (C,) of the table, ascending for each pair.
        frames: (C,) of each of them.
    """

    spans: dict[Pair, tuple[int, int]]
    rows: NDArray[np.int32]
    frames: NDArray[np.int32]


class PackedContacts(StoredColumns, ContactTable):
    """A table that makes columns, and rows of a pair, when they are asked for."""

    _groups = tuple((f.name,) for f in fields(ContactTable))

    def __init__(self, given: Points, owner: NDArray[np.int16], order: Order) -> None:
        points, counts = given.points, given.counts

        def column(names: tuple[str, ...]) -> Mapping[str, NDArray[Any]]:
            (name,) = names
            if name == "frame":
                return {name: np.repeat(np.arange(len(counts), dtype=np.int32), counts)}
            if name.startswith("body"):
                return {name: owner[points[f"geom{name[-1]}"]]}
            return {name: np.ascontiguousarray(points[name])}

        super().__init__(column)
        vars(self).update({"_points": points, "_order": order, "_of_pair": {}, "_known": {}})

    _points: NDArray[Any]
    _order: Order
    _of_pair: dict[Pair, NDArray[Any]]
    _known: dict[tuple[Pair, str], NDArray[Any]]

    def __len__(self) -> int:
        """C."""
        return len(self._points)

    @property
    def pairs(self) -> list[Pair]:
        """As in the base class."""
        return list(self._order.spans)

    def rows(self, pair: Pair) -> NDArray[np.intp]:
        """As in the base class."""
        return self._order.rows[slice(*self._order.spans.get(pair, (0, 0)))].astype(np.intp)

    def of_pair(self, pair: Pair, *columns: str) -> tuple[NDArray[Any], ...]:
        """As in the base class."""
        for name in columns:
            if (pair, name) not in self._known:
                self._known[pair, name] = self._column(pair, name)
        return tuple(self._known[pair, name] for name in columns)

    def _column(self, pair: Pair, column: str) -> NDArray[Any]:
        name, _, axis = column.partition(".")
        span = slice(*self._order.spans.get(pair, (0, 0)))
        if name == "frame":
            return self._order.frames[span]
        if name.startswith("body"):
            return np.full(span.stop - span.start, pair[int(name[-1]) - 1], np.int16)
        if pair not in self._of_pair:
            points = np.empty(span.stop - span.start, POINT)
            kernel_choice.contacts().take_points(
                _words(self._points), self._order.rows[span], _words(points)
            )
            self._of_pair[pair] = points
        points = self._of_pair[pair]
        if name.startswith("geom"):
            return np.ascontiguousarray(points[name])
        begin, width = _PLACES[name]
        first = begin + ("xyz".index(axis) if axis else 0)
        found = np.empty((len(points), 1 if axis else width), np.float32)
        kernel_choice.contacts().take_column(_words(points), first, found.view(np.uint32))
        return found if found.shape[1] > 1 else found[:, 0]


def _words(points: NDArray[Any]) -> NDArray[np.uint32]:
    """(C, 12) the bytes of (C,) POINT in fours; all but the last are numbers."""
    return points.view(np.uint32).reshape(len(points), _WORDS)


def _sorted(given: Points, names: GeomNames) -> Order | None:
    """The points by pair; None where they are not in the table's order.

    Raises:
        TraceError: a geom index that no body has.
    """
    geoms = len(names.owner)
    if not len(given.points) or geoms**2 > _MOST_KEYS:
        return None
    seen = np.zeros((geoms, geoms), np.int64)
    if not kernel_choice.contacts().count_pairs(given.geoms, seen):
        names.bodies(given.points)  # says which
    geom1, geom2 = np.nonzero(seen)
    body1, body2 = names.owner[geom1], names.owner[geom2]
    if (body1 >= body2).any():
        return None
    order = np.lexsort((geom2, geom1, body2, body1))
    geom1, geom2, body1, body2 = geom1[order], geom2[order], body1[order], body2[order]
    rank = np.zeros((geoms, geoms), np.int32)
    rank[geom1, geom2] = np.arange(len(order))
    new = (body1[1:] != body1[:-1]) | (body2[1:] != body2[:-1])
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    ends = np.cumsum(np.add.reduceat(seen[geom1, geom2], first))
    begins = np.concatenate([[0], ends[:-1]])
    pair = np.concatenate([[0], np.cumsum(new)])
    rows, frames = np.empty((2, len(given.geoms)), np.int32)
    if not kernel_choice.contacts().sort_points(
        given.geoms, given.counts, rank, pair, begins.copy(), rows, frames
    ):
        return None
    pairs = zip(body1[first].tolist(), body2[first].tolist(), strict=True)
    spans = zip(begins.tolist(), ends.tolist(), strict=True)
    return Order(dict(zip(pairs, spans, strict=True)), rows, frames)
