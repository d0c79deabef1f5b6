"""Forces between pairs of bodies, summed over their contact points."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair

from .contact_kernels import add_up, add_up_normal, strange
from .missing_values import Gaps
from .query import Growth, Query
from .store import Store

F64 = NDArray[np.float64]

ONE_STEP = 1.5
"""A spacing below so many of another is one of them."""

SHOWN, SHOWN_COARSELY = 1 / 3, 0.75
"""Share of the ends of touches that show between frames, of those that do if all were recorded, at
the least; and at spacings from ``COARSE`` on. Recorded with 4 steps to a frame it is .35 to 1.33;
of every 3rd frame of such, or fewer, at most .85 and mostly 0 to .4."""

COARSE = 0.025
"""s, as ``contact_for``: a whole touch fits in between."""


class ContactSums:
    """Per body pair (indices into ``header.bodies``): sums over the contact rows of each frame."""

    def __init__(
        self, episode: Episode, gaps: Gaps | None = None, store: Store | None = None
    ) -> None:
        """Nothing is computed before it is asked for. ``gaps``, ``store``: of the same episode."""
        self._store = store or Store()
        self._gaps = gaps or Gaps(episode)
        self._episode = self._gaps.episode if gaps is None else episode
        self._frames = len(episode)
        self._normal: dict[Pair, F64] = {}
        self._vertical: dict[Pair, F64] = {}
        self._peak: dict[Pair, F64] = {}

    @cached_property
    def pairs(self) -> list[Pair]:
        """Every pair (i < j) with at least one contact row."""

        def measure(near: Any) -> Iterable[Pair]:
            return (self._episode if near is None else near.episode).contacts.pairs

        return self._store.items(Query("force", "pairs"), measure)

    @cached_property
    def _beside(self) -> dict[int, list[int]]:
        found: dict[int, list[int]] = {}
        for i, j in self.pairs:
            found.setdefault(i, []).append(j)
            found.setdefault(j, []).append(i)
        return found

    def beside(self, body: int) -> list[int]:
        """The bodies that have a contact row with the given one, ascending."""
        return self._beside.get(body, [])

    def normal(self, i: int, j: int) -> F64:
        """(T,) N, sum of the magnitudes of the normal forces of all contacts of the pair.

        A book wedged between two walls has a vector sum of 0 and two real contacts.
        """
        key = (min(i, j), max(i, j))
        if key not in self._normal:
            self._normal[key] = self._sum("normal", key, ContactSums._add_normal)
        return self._normal[key]

    def _sum(self, name: str, key: Pair, add: Callable[[ContactSums, Pair], F64]) -> F64:
        def measure(near: Any) -> F64:
            return add(self if near is None else near.signals.contact_sums, key)

        query = Query("force", name, (str(key[0]), str(key[1])))
        found = self._store.column(query, measure, Growth.PER_FRAME)
        assert found is not None
        return found

    def _add_normal(self, key: Pair) -> F64:
        frame, force, normal = self._episode.contacts.of_pair(key, "frame", "force", "normal")
        sums, sound = add_up_normal(frame, force, normal, self._frames)
        return sums if sound else self._sound(key, frame, force, normal)

    def _sound(self, key: Pair, frame: Any, force: Any, normal: Any) -> F64:
        """Like ``normal``, for valid contacts; where others are, the force is unknown."""
        long, pulls = strange(force, normal)
        for rows, why in (
            (long, "a contact normal is not of unit length"),
            (pulls, "a contact force pulls"),
        ):
            if rows.any():
                self._gaps.mark(key, frame[rows], why)
        good = ~(long | pulls)
        return add_up_normal(frame[good], force[good], normal[good], self._frames)[0]

    def look(self, pairs: set[Pair]) -> None:
        """Look whether the contacts of these pairs are sound, as ``normal`` does."""
        for pair in pairs - self._normal.keys():
            self.normal(*pair)

    def unknown(self, i: int, j: int) -> NDArray[np.bool_] | None:
        """(T,) true where the force between two bodies is not known; None if nowhere."""
        self.normal(i, j)
        return self._gaps.of_pair(i, j)

    def peak(self, i: int, j: int) -> F64:
        """(T,) N, largest value of ``normal`` over the physics steps within each frame."""
        key = (min(i, j), max(i, j))
        if key not in self._peak:
            self._peak[key] = self._sum("peak", key, ContactSums._find_peak)
        return self._peak[key]

    def _find_peak(self, key: Pair) -> F64:
        frame, values = self._episode.contacts.of_pair(key, "frame", "peak_force")
        peak = np.zeros(self._frames)
        np.maximum.at(peak, frame, values)
        return np.maximum(peak, self.normal(*key))

    @cached_property
    def covers_frames(self) -> bool:
        """Peaks are those of all physics steps between frames: no touch can have been missed.

        Then a touch that ends between two frames leaves a row with zero force and its peak, but for
        one that ends in the first step. Frames that were left out of a recording took these with them.
        """
        t, step = self._episode.t, self._episode.header.physics_dt
        dt = self._episode.dt
        if dt <= ONE_STEP * step:
            return True
        near = np.diff(t) <= ONE_STEP * dt
        if self._gaps.unseen is not None:
            near &= ~(self._gaps.unseen[1:] | self._gaps.unseen[:-1])
        ends = shown = 0
        for i, j in self.pairs:
            touching = self.normal(i, j) > 0
            end = touching[:-1] & ~touching[1:] & near
            ends += int(end.sum())
            shown += int((self.peak(i, j)[1:][end] > 0).sum())
        share = (SHOWN if dt < COARSE else SHOWN_COARSELY) * (1 - step / dt)
        return shown > 0 and shown >= share * ends

    def upward(self, on: int, by: int) -> F64:
        """(T,) N, vertical component (up positive) of the total force on one body by another."""
        key = (min(on, by), max(on, by))
        if key not in self._vertical:
            self._vertical[key] = self._sum("upward", key, ContactSums._add_upward)
        return self._vertical[key] if on > by else -self._vertical[key]

    def _add_upward(self, key: Pair) -> F64:
        self.normal(*key)  # looks whether the contacts are sound
        frame, force = self._episode.contacts.of_pair(key, "frame", "force.z")
        return add_up(frame, force, self._frames)

    def touching(self, i: int, j: int) -> NDArray[np.bool_]:
        """(T,) true where a force is exchanged."""
        return self.normal(i, j) > 0
