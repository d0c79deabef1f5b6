"""Contacts as PyBullet lists them: rows of those that touch, and their points."""

from __future__ import annotations

from struct import Struct
from typing import Any, Dict, Optional, Sequence, Tuple

import numpy as np

from .point_log import Row
from .zip_trace import CONTACT_POINT

_TOUCH = np.dtype(
    [("position", "<f8", 3), ("normal", "<f8", 3), ("axes", "<f8", (2, 3)), ("apart", "<f8"),
     ("forces", "<f8", 3), ("geoms", "<u2", 2)]
)  # fmt: skip
"""Along the normal and both axes of friction there is a force."""
_pack_touch = Struct("<16d2H").pack


class BulletTouches:
    """Reads what ``getContactPoints`` returns.

    Attributes:
        first: body and link → the first of its shapes in the trace.
    """

    def __init__(self) -> None:
        """Begin without shapes."""
        self.first: dict[tuple[int, int], int] = {}
        self._pairs = _Pairs(self.first)

    def rows(self, contacts: Sequence[Any]) -> list[Row]:
        """Rows of those that touch."""
        pairs = self._pairs
        return [(pairs[c[1:5]], c[9], c) for c in contacts if c[9] > 0.0 or c[8] <= 0.0]

    def pack(self, contact: Any) -> bytes:
        """Bytes of a contact, for ``read_touches``."""
        _, a, b, link, other, (x, y, z), _, (u, v, w), apart, size, *along = contact
        push, (i, j, k), pull, (r, s, t) = along
        one, two = self.first[a, link], self.first[b, other]
        return _pack_touch(x, y, z, u, v, w, i, j, k, r, s, t, apart, size, push, pull, one, two)


def read_touches(block: bytes) -> Any:
    """(C,) CONTACT_POINT of packed contacts, one after the other; their peaks are left zero."""
    told = np.frombuffer(block, _TOUCH)
    points = np.zeros(len(told), CONTACT_POINT)
    forces, axes = told["forces"][..., None], told["axes"]
    # Bullet's normal points from the second body to the first
    points["position"], points["normal"] = told["position"], -told["normal"]
    points["force"] = -forces[:, 0] * told["normal"] - (forces[:, 1:] * axes).sum(axis=1)
    points["depth"] = -told["apart"]
    points["geom1"], points["geom2"] = told["geoms"].T
    return points


class _Pairs(Dict[Tuple[int, int, int, int], Optional[int]]):
    """Bodies and links of a contact → number of the pair, in whatever order they stand; None: not in the trace."""

    def __init__(self, first: dict[tuple[int, int], int]) -> None:
        super().__init__()
        self._first = first

    def __missing__(self, key: tuple[int, int, int, int]) -> int | None:
        one, other = self._first.get((key[0], key[2])), self._first.get((key[1], key[3]))
        pair = None if one is None or other is None else min(one, other) << 20 | max(one, other)
        self[key] = pair
        return pair
