"""The contact table of an episode: one row per contact point and frame."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Pair = tuple[int, int]
"""Two indices into ``header.bodies``, the lower one first."""


@dataclass(frozen=True, eq=False)
class ContactTable:
    """Contacts in canonical order: by frame, then body pair, then geom pair, then as recorded.

    Body 1 has the lower index of the two. A pair that touched only between two frames has a row
    with zero force and its substep peak.

    Attributes:
        frame: (C,) frame index.
        body1, body2: (C,) index into ``header.bodies``; body1 < body2.
        geom1, geom2: (C,) index into the episode's geoms, counted over all bodies in order.
        position: (C, 3) m, world.
        normal: (C, 3) unit, world, from body 1 to body 2.
        force: (C, 3) N, world, on body 2 by body 1, at the frame.
        peak_force: (C,) N, largest substep value within the frame of the *pair's* summed normal
            force; the same on every row of the pair.
        depth: (C,) m, penetration (positive) or gap (negative).
    """

    frame: NDArray[np.int32]
    body1: NDArray[np.int16]
    body2: NDArray[np.int16]
    geom1: NDArray[np.uint16]
    geom2: NDArray[np.uint16]
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    force: NDArray[np.float32]
    peak_force: NDArray[np.float32]
    depth: NDArray[np.float32]

    def __len__(self) -> int:
        """C."""
        return len(self.frame)

    @classmethod
    def build(
        cls,
        frame: ArrayLike,
        body1: ArrayLike,
        body2: ArrayLike,
        geom1: ArrayLike,
        geom2: ArrayLike,
        position: ArrayLike,
        normal: ArrayLike,
        force: ArrayLike,
        peak_force: ArrayLike,
        depth: ArrayLike,
    ) -> ContactTable:
        """Cast, swap and sort rows given in any order into the canonical table.

        Shapes as in the class; where ``body1 > body2`` the two are exchanged, and normal and
        force change sign with them.
        """
        f, b1, b2 = np.asarray(frame, np.int32), np.asarray(body1, np.int16), np.asarray(body2)
        b2 = b2.astype(np.int16)
        g1, g2 = np.asarray(geom1, np.uint16), np.asarray(geom2, np.uint16)
        vectors = [np.asarray(v, np.float32).reshape(-1, 3) for v in (position, normal, force)]
        swap = b1 > b2
        sign = np.where(swap, -1, 1).astype(np.float32)[:, None]
        b1, b2 = np.where(swap, b2, b1), np.where(swap, b1, b2)
        g1, g2 = np.where(swap, g2, g1), np.where(swap, g1, g2)
        order = np.lexsort((g2, g1, b2, b1, f))
        return cls(
            f[order],
            b1[order],
            b2[order],
            g1[order],
            g2[order],
            vectors[0][order],
            # "+ 0" turns a flipped zero's sign back, so that equal contacts are equal bytes
            (vectors[1] * sign)[order] + np.float32(0),
            (vectors[2] * sign)[order] + np.float32(0),
            np.asarray(peak_force, np.float32)[order],
            np.asarray(depth, np.float32)[order],
        )

    @classmethod
    def empty(cls) -> ContactTable:
        """A table without rows."""
        none, vec = np.zeros(0), np.zeros((0, 3))
        return cls.build(none, none, none, none, none, vec, vec, vec, none, none)

    @property
    def pairs(self) -> list[Pair]:
        """Every pair of bodies that has a row, ascending."""
        return list(self._pair_order[1])

    def rows(self, pair: Pair) -> NDArray[np.intp]:
        """Row numbers of a pair, ascending, so by frame; empty if the two never touch."""
        order, spans = self._pair_order
        return order[spans.get(pair, slice(0))]

    def of_pair(self, pair: Pair, *columns: str) -> tuple[NDArray[Any], ...]:
        """Some columns of one pair's rows; ``force.z`` is a component of a vector.

        Not to be written to. A stored table reads nothing of other pairs, and hands out the rows in
        the order in which they are stored, which may be any.
        """
        rows = self._pair_order[1].get(pair, slice(0))
        return tuple(self._sorted(column)[rows] for column in columns)

    def unordered(self, *columns: str) -> tuple[NDArray[Any], ...]:
        """Whole columns, with rows in any order, but the same one in all of them.

        A stored table hands them out as they are stored, which is cheaper than by frame.
        """
        return tuple(getattr(self, column) for column in columns)

    def _sorted(self, column: str) -> NDArray[Any]:
        """A column, pair by pair: sorted once, every pair is a slice of it."""
        found = self._columns_by_pair.get(column)
        if found is None:
            name, _, axis = column.partition(".")
            values: NDArray[Any] = getattr(self, name)
            values = values[:, "xyz".index(axis)] if axis else values
            found = self._columns_by_pair[column] = values.take(self._pair_order[0], axis=0)
        return found

    @cached_property
    def _columns_by_pair(self) -> dict[str, NDArray[Any]]:
        return {}

    @cached_property
    def _pair_order(self) -> tuple[NDArray[np.intp], dict[Pair, slice]]:
        """Row numbers, pair by pair, and the place of each pair among them."""
        bodies = int(self.body2.max(initial=0)) + 1
        key = self.body1.astype(np.int32) * bodies + self.body2
        if bodies <= 256:  # two bytes: the stable sort is then a radix sort, ten times faster
            key = key.astype(np.uint16)
        order = np.argsort(key, kind="stable")
        some = key[order]
        cuts = np.flatnonzero(some[1:] != some[:-1]) + 1
        edges = [0, *cuts.tolist(), len(order)] if len(order) else []
        return order, {
            (int(self.body1[order[first]]), int(self.body2[order[first]])): slice(first, stop)
            for first, stop in pairwise(edges)
        }

    def where(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> ContactTable:
        """The rows for which ``keep`` (C,) is true, in the same order; or those with its indices."""
        return ContactTable(*(getattr(self, f.name)[keep] for f in fields(self)))

    def between(self, a: frozenset[int], b: frozenset[int]) -> NDArray[np.bool_]:
        """(C,) true where one body is in a and the other in b (indices into header.bodies)."""
        in_a1, in_a2 = (np.isin(x, list(a)) for x in (self.body1, self.body2))
        in_b1, in_b2 = (np.isin(x, list(b)) for x in (self.body1, self.body2))
        return (in_a1 & in_b2) | (in_a2 & in_b1)
