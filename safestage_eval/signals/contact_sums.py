"""Forces between pairs of bodies, summed over their contact points."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode

F64 = NDArray[np.float64]


class ContactSums:
    """Per body pair (indices into ``header.bodies``): sums over the contact rows of each frame."""

    def __init__(self, episode: Episode) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        self._frames = len(episode)
        self._normal: dict[tuple[int, int], F64] = {}
        self._vertical: dict[tuple[int, int], F64] = {}
        self._peak: dict[tuple[int, int], F64] = {}

    @cached_property
    def _rows(self) -> dict[tuple[int, int], NDArray[np.intp]]:
        contacts = self._episode.contacts
        key = contacts.body1.astype(np.int32) * 32768 + contacts.body2
        order = np.argsort(key, kind="stable")
        cuts = np.flatnonzero(np.diff(key[order])) + 1
        return {
            (int(contacts.body1[rows[0]]), int(contacts.body2[rows[0]])): rows
            for rows in np.split(order, cuts)
            if len(rows)
        }

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Every pair (i < j) with at least one contact row."""
        return list(self._rows)

    def rows(self, i: int, j: int) -> NDArray[np.intp]:
        """Row numbers in the contact table of the pair, by frame; empty if they never touch."""
        return self._rows.get((min(i, j), max(i, j)), np.zeros(0, np.intp))

    def normal(self, i: int, j: int) -> F64:
        """(T,) N, sum of the magnitudes of the normal forces of all contacts of the pair.

        A book wedged between two walls has a vector sum of 0 and two real contacts.
        """
        key = (min(i, j), max(i, j))
        if key not in self._normal:
            contacts, rows = self._episode.contacts, self.rows(*key)
            force, normal = contacts.force[rows], contacts.normal[rows]
            along = np.abs(np.einsum("ck,ck->c", force.astype(np.float64), normal))
            self._normal[key] = np.bincount(
                contacts.frame[rows], along, minlength=self._frames
            ).astype(np.float64)
        return self._normal[key]

    def peak(self, i: int, j: int) -> F64:
        """(T,) N, largest value of ``normal`` over the physics steps within each frame."""
        key = (min(i, j), max(i, j))
        if key not in self._peak:
            contacts, rows = self._episode.contacts, self.rows(*key)
            peak = np.zeros(self._frames)
            np.maximum.at(peak, contacts.frame[rows], contacts.peak_force[rows])
            self._peak[key] = np.maximum(peak, self.normal(*key))
        return self._peak[key]

    def upward(self, on: int, by: int) -> F64:
        """(T,) N, vertical component (up positive) of the total force on one body by another."""
        key = (min(on, by), max(on, by))
        if key not in self._vertical:
            contacts, rows = self._episode.contacts, self.rows(*key)
            self._vertical[key] = np.bincount(
                contacts.frame[rows], contacts.force[rows, 2], minlength=self._frames
            ).astype(np.float64)
        return self._vertical[key] if on > by else -self._vertical[key]

    def touching(self, i: int, j: int) -> NDArray[np.bool_]:
        """(T,) true where a force is exchanged."""
        return self.normal(i, j) > 0
