"""Contacts as they are gathered frame by frame: packed points between two geoms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval.episode import ContactTable, Header
from safestage_eval.errors import TraceError

POINT = np.dtype(
    [
        ("position", "<f4", 3),
        ("normal", "<f4", 3),
        ("force", "<f4", 3),
        ("peak_force", "<f4"),
        ("depth", "<f4"),
        ("geom1", "<u2"),
        ("geom2", "<u2"),
    ]
)
"""One contact, 48 bytes: m, unit, N (on geom 2's body by geom 1's), N, m, geom indices counted over
all bodies in the header's order. The bodies follow from the geoms."""

RAW = np.dtype((np.void, POINT.itemsize))
"""A point as bytes: moving whole points is several times faster than moving their fields."""

_NAMES = POINT.names or ()
_ITEMS = np.dtype([(name, f"V{POINT[name].itemsize}") for name in _NAMES])
"""POINT with every field as bytes: a vector is copied as one item."""

Contacts = NDArray[Any] | Mapping[str, ArrayLike] | Sequence[Mapping[str, Any]]
"""Contacts as a recorder passes them: a (C,) array of POINT, columns by name, or a list of rows."""


class GeomNames:
    """Finds geoms by body and geom name.

    Attributes:
        owner: (G,) index of each geom's body.
    """

    def __init__(self, header: Header) -> None:
        self.owner = np.repeat(
            np.arange(len(header.bodies), dtype=np.int16), [len(b.geoms) for b in header.bodies]
        )
        self._first: dict[str, int] = {}
        self._named: dict[tuple[str, str], int] = {}
        self._where = header.episode_id
        index = 0
        for body in header.bodies:
            if body.geoms:
                self._first[body.name] = index
            for geom in body.geoms:
                self._named[body.name, geom.name] = index
                index += 1

    def index(self, body: str, geom: str | int | None) -> int:
        """Return the index of a geom, by name within the body or by number over all bodies; without either, of its first one.

        Raises:
            TraceError: no such body, no such geom, or a body without geoms.
        """
        if isinstance(geom, int | np.integer):
            return int(geom)
        number = self._first.get(body) if geom is None else self._named.get((body, geom))
        if number is None:
            expected = "a body with geoms" if geom is None else f"a geom {geom!r}"
            raise TraceError(
                self._where,
                f"a contact names {body!r}, which is not {expected}.",
                ", ".join(self._first) or "no body has geoms",
                "declare the body with its geoms before the first frame",
            )
        return number

    def bodies(self, points: NDArray[Any]) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return the body indices (C,), (C,) of points. Raises TraceError for a geom that no body has."""
        for name in ("geom1", "geom2"):
            highest = int(points[name].max()) if len(points) else -1
            if highest >= len(self.owner):
                raise TraceError(
                    self._where,
                    f"a contact's {name} is {highest}; there are {len(self.owner)} geoms.",
                    fix="count geoms over all bodies in the header's order",
                )
        return self.owner[points["geom1"]], self.owner[points["geom2"]]


def pack_contacts(contacts: Contacts, names: GeomNames) -> NDArray[Any]:
    """Return the contacts of one frame as a (C,) array of POINT.

    Rows need ``position``, ``normal``, ``force`` and either ``geom1``/``geom2`` or
    ``body1``/``body2``; ``peak_force`` defaults to the pair's summed normal force at the frame,
    ``depth`` to 0. Columns need ``geom1``, ``geom2``, ``position``, ``normal``, ``force``.

    Raises:
        TraceError: a field is missing, or a body or geom is unknown.
    """
    if isinstance(contacts, np.ndarray):
        if contacts.dtype == POINT:
            return np.ascontiguousarray(contacts)
        columns: Mapping[str, ArrayLike] = {
            name: contacts[name] for name in contacts.dtype.names or ()
        }
    elif isinstance(contacts, Mapping):
        columns = contacts
    else:
        columns = _columns(contacts, names)
    missing = [n for n in ("geom1", "geom2", "position", "normal", "force") if n not in columns]
    if missing:
        raise TraceError("contacts", f"{', '.join(missing)} not given.", ", ".join(_NAMES))
    points = np.empty(len(np.asarray(columns["geom1"])), POINT)
    for name in ("geom1", "geom2", "position", "normal", "force"):
        points[name] = columns[name]
    if "peak_force" in columns:
        points["peak_force"] = columns["peak_force"]
    else:
        points["peak_force"] = _pair_force(points, names)
    points["depth"] = columns.get("depth", 0.0)
    return points


def _pair_force(points: NDArray[Any], names: GeomNames) -> NDArray[np.float64]:
    """(C,) N, normal force summed over all points between the same two bodies."""
    if not len(points):
        return np.zeros(0)
    force = np.abs(np.einsum("ij,ij->i", points["force"], points["normal"]))
    body1, body2 = names.bodies(points)
    low, high = np.minimum(body1, body2), np.maximum(body1, body2)
    pair = np.unique(low.astype(np.int64) << 16 | high, return_inverse=True)[1]
    return np.bincount(pair, force).astype(np.float64)[pair]


def _columns(rows: Sequence[Mapping[str, Any]], names: GeomNames) -> dict[str, ArrayLike]:
    columns: dict[str, ArrayLike] = {
        "geom1": [names.index(r.get("body1", ""), r.get("geom1")) for r in rows],
        "geom2": [names.index(r.get("body2", ""), r.get("geom2")) for r in rows],
    }
    for name in ("position", "normal", "force", "peak_force", "depth"):
        values = [row[name] for row in rows if name in row]
        if values and len(values) < len(rows):
            raise TraceError("contacts", f"{name} is given for some rows only")
        if values:
            columns[name] = values
    if not rows:
        columns |= {name: np.zeros((0, 3)) for name in ("position", "normal", "force")}
    return columns


def contact_table(
    points: NDArray[Any], counts: NDArray[np.integer], names: GeomNames
) -> ContactTable:
    """Make the canonical table of contacts.

    Args:
        points: (C,) POINT of consecutive frames.
        counts: (T,) contacts per frame.
        names: the geoms that the points refer to.

    Raises:
        TraceError: a geom index that no body has.
    """
    frame = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    body1, body2 = names.bodies(points)
    items = points.view(_ITEMS)
    columns = {
        name: np.ascontiguousarray(items[name])
        .view(POINT[name].base)
        .reshape(-1, *POINT[name].shape)
        for name in _NAMES
    }
    canonical = _is_canonical(frame, body1, body2, columns["geom1"], columns["geom2"])
    make = ContactTable if canonical else ContactTable.build
    return make(frame=frame, body1=body1, body2=body2, **columns)


def _is_canonical(
    frame: NDArray[np.int32],
    body1: NDArray[np.int16],
    body2: NDArray[np.int16],
    geom1: NDArray[np.uint16],
    geom2: NDArray[np.uint16],
) -> bool:
    """True if the rows are in the order of the contact table."""
    if (body1 >= body2).any():
        return False
    # geoms are numbered body by body, yet (body1, body2, geom1, geom2) is not (geom1, geom2)
    pair = body1.astype(np.int32) << 16 | body2
    geoms = geom1.astype(np.uint32) << 16 | geom2
    behind = (pair[1:] < pair[:-1]) | ((pair[1:] == pair[:-1]) & (geoms[1:] < geoms[:-1]))
    return not bool((behind & (frame[1:] == frame[:-1])).any())


def table_points(contacts: ContactTable) -> NDArray[Any]:
    """Return the (C,) POINT of the contacts of a table, in its order."""
    points = np.empty(len(contacts), POINT)
    for name in _NAMES:
        points[name] = getattr(contacts, name)
    return points
