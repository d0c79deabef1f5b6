"""A contact table over packed points that are kept as they came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, check_contacts
from safestage_eval.episode.contacts import Pair

from .contact_points import POINT, RAW, GeomNames, table
from .lazy import StoredColumns

_STORED = POINT.names or ()

_MOST_KEYS = 1 << 22
"""Pairs of geoms up to which each has a number of its own."""


def contact_table(
    points: NDArray[Any], counts: NDArray[np.int64], names: GeomNames, where: str, checked: bool
) -> ContactTable:
    """The canonical table of the (C,) points of consecutive frames, ``counts`` (T,) per frame.

    Points in the table's order are not copied before they are asked for. ``checked``: raise on
    broken invariants.

    Raises:
        TraceError: a geom index that no body has, or values that are not finite.
    """
    code, spans = _codes(points, counts, names)
    rows = (
        table(points, counts, names)
        if code is None
        else PackedContacts(points, counts, names.owner, code, spans)
    )
    if checked and (code is None or not _finite(points)):
        errors = check_contacts(rows, names.owner, len(counts), where)
        if errors:
            raise errors[0]
    return rows


class PackedContacts(StoredColumns, ContactTable):
    """A table that makes columns, and rows of a pair, when they are asked for."""

    _groups = tuple((f.name,) for f in fields(ContactTable))

    def __init__(
        self,
        points: NDArray[Any],
        counts: NDArray[np.int64],
        owner: NDArray[np.int16],
        code: NDArray[np.integer],
        spans: dict[Pair, tuple[int, int]],
    ) -> None:
        def column(names: tuple[str, ...]) -> Mapping[str, NDArray[Any]]:
            (name,) = names
            if name == "frame":
                return {name: np.repeat(np.arange(len(counts), dtype=np.int32), counts)}
            if name.startswith("body"):
                return {name: owner[points[f"geom{name[-1]}"]]}
            return {name: np.ascontiguousarray(points[name])}

        super().__init__(column)
        given = {"_points": points, "_code": code, "_spans": spans, "_known_rows": {}}
        vars(self).update(given)

    _points: NDArray[Any]
    _code: NDArray[np.integer]
    _spans: dict[Pair, tuple[int, int]]
    _known_rows: dict[Pair, NDArray[np.intp]]

    @property
    def pairs(self) -> list[Pair]:
        """As in the base class."""
        return list(self._spans)

    def rows(self, pair: Pair) -> NDArray[np.intp]:
        """As in the base class."""
        if pair not in self._known_rows:
            first, end = self._spans.get(pair, (0, 0))
            found = np.flatnonzero((self._code >= first) & (self._code < end))
            self._known_rows[pair] = found
        return self._known_rows[pair]

    def of_pair(self, pair: Pair, *columns: str) -> tuple[NDArray[Any], ...]:
        """As in the base class."""
        rows = self.rows(pair)
        # as raw bytes: ten times faster than points[rows]
        points = self._points.view(RAW).take(rows).view(POINT)
        found = []
        for column in columns:
            name, _, axis = column.partition(".")
            values = points[name] if name in _STORED else getattr(self, name).take(rows)
            found.append(np.ascontiguousarray(values[:, "xyz".index(axis)] if axis else values))
        return tuple(found)


def _codes(
    points: NDArray[Any], counts: NDArray[np.int64], names: GeomNames
) -> tuple[NDArray[np.integer] | None, dict[Pair, tuple[int, int]]]:
    """(C,) rank of each point's pair of geoms in the table's order, and each pair's range of ranks.

    None in place of ranks where the points are in another order.

    Raises:
        TraceError: a geom index that no body has.
    """
    geoms = len(names.owner)
    if not len(points) or geoms**2 > _MOST_KEYS:
        return None, {}
    # the last four bytes of a point
    both = np.ascontiguousarray(points.view("<u4").reshape(len(points), -1)[:, -1])
    first, second = both.view("<u2").reshape(-1, 2).T
    if max(int(first.max()), int(second.max())) >= geoms:
        names.bodies(points)  # says which
    key = np.multiply(first, geoms, dtype=np.int32)
    key += second
    seen = np.zeros(geoms**2, bool)
    seen[key] = True
    present = np.flatnonzero(seen)
    geom1, geom2 = np.divmod(present, geoms)
    body1, body2 = names.owner[geom1], names.owner[geom2]
    if (body1 >= body2).any():
        return None, {}
    order = np.lexsort((geom2, geom1, body2, body1))
    rank = np.zeros(geoms**2, np.min_scalar_type(len(order)))
    rank[present[order]] = np.arange(len(order))
    code: NDArray[Any] = rank.take(key)
    back = code[1:] < code[:-1]
    begins = np.cumsum(counts)[:-1]
    back[begins[(begins > 0) & (begins < len(points))] - 1] = False
    if back.any():
        return None, {}
    pairs = list(zip(body1[order].tolist(), body2[order].tolist(), strict=True))
    cuts = [i for i in range(len(pairs)) if not i or pairs[i] != pairs[i - 1]]
    ends = [*cuts[1:], len(pairs)]
    return code, {pairs[a]: (a, b) for a, b in zip(cuts, ends, strict=True)}


def _finite(points: NDArray[Any]) -> bool:
    """Whether the numbers are finite for sure; the geoms among them hardly ever leave that open."""
    with np.errstate(all="ignore"):
        return bool(np.isfinite(points.view("<f4").sum()))
