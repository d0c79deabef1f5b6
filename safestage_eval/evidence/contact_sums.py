"""Forces between pairs of bodies, summed over their contact points."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.invariants import ROUNDED
from safestage_eval.episode.rounding import SINGLE, Rounding, most_off, rounding_of

from .missing_values import Gaps

F64 = NDArray[np.float64]

ONE_STEP = 1.5
"""A spacing below so many of another is one of them."""

SHOWN, SHOWN_COARSELY = 1 / 3, 0.75
"""Share of the ends of touches that show between frames, of those that do if all were recorded, at
the least; and at spacings from ``COARSE`` on. Recorded with 4 steps to a frame it is .35 to 1.33;
of every 3rd frame of such, or fewer, at most .85 and mostly 0 to .4."""

COARSE = 0.025
"""s, as ``contact_for``: a whole touch fits in between."""

UNIT = 1e-3
"""Allowed deviation of a normal's length from 1, besides its rounding."""
PULL = 1e-3
"""N, and share of the force, by which a contact may pull for rounding."""


class ContactSums:
    """Per body pair (indices into ``header.bodies``): sums over the contact rows of each frame."""

    def __init__(self, episode: Episode, gaps: Gaps | None = None) -> None:
        """Nothing is computed before it is asked for. ``gaps``: of the same episode."""
        self._gaps = gaps or Gaps(episode)
        self._episode = self._gaps.episode if gaps is None else episode
        self._frames = len(episode)
        self._normal: dict[Pair, F64] = {}
        self._vertical: dict[Pair, F64] = {}
        self._peak: dict[Pair, F64] = {}

    @cached_property
    def pairs(self) -> list[Pair]:
        """Every pair (i < j) with at least one contact row, or which may have touched unrecorded."""
        recorded = self._episode.contacts.pairs
        moved = self._gaps.unexplained()
        return sorted({*recorded, *self._gaps.mark_unexplained(moved)})

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
            self._normal[key] = self._add_normal(key)
        return self._normal[key]

    def _add_normal(self, key: Pair) -> F64:
        """Forces of sound contacts; the force is unknown at frames with others."""
        frame, force, normal = self._episode.contacts.of_pair(key, "frame", "force", "normal")
        along, size = _along(force, normal), _along(normal, normal)
        if along.size and not (along.min() >= 0 and np.abs(size - 1).max() <= 2 * UNIT):
            long, pulls = strange(force, normal)
            for rows, why in (
                (long, "a contact normal is not of unit length"),
                (pulls, "a contact force pulls"),
            ):
                if rows.any():
                    self._gaps.mark(key, frame[rows], why)
            along[long | pulls] = 0.0
        return np.asarray(np.bincount(frame, np.abs(along), self._frames), np.float64)

    def look(self, pairs: set[Pair]) -> None:
        """Look whether the contacts of these pairs are sound, as ``normal`` does."""
        for pair in pairs - self._normal.keys():
            self.normal(*pair)

    def unknown(self, i: int, j: int) -> NDArray[np.bool_] | None:
        """(T,) true where the force between two bodies is not known; None if nowhere."""
        self.normal(i, j)
        return self._gaps.of_pair(i, j)

    @cached_property
    def rounding(self) -> Rounding:
        """That of the recorded forces; mostly one pair tells that they were not rounded."""
        found = []
        for pair in self.pairs:
            (force,) = self._episode.contacts.of_pair(pair, "force.z")
            if force.any():
                found.append(rounding_of(force))
                if found[-1] == SINGLE:
                    return SINGLE
        return Rounding(*map(min, zip(*found, strict=True))) if found else SINGLE

    def touch_unknown(self, i: int, j: int) -> NDArray[np.bool_] | None:
        """(T,) true where nobody knows whether two bodies touched since the frame before; None if nowhere."""
        normal = self.normal(i, j)
        self.peak(i, j)
        force, peak = self._gaps.of_pair(i, j), self._gaps.of_peak(i, j)
        if peak is None:
            return force
        between = peak & ~(normal > 0)
        return between if force is None else between | force

    def peak(self, i: int, j: int) -> F64:
        """(T,) N, largest value of ``normal`` over the physics steps within each frame.

        At the least, where no peak was recorded.
        """
        key = (min(i, j), max(i, j))
        if key not in self._peak:
            self._peak[key] = self._find_peak(key)
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
            touching, peak = self.normal(i, j) > 0, self.peak(i, j)
            end = touching[:-1] & ~touching[1:] & near
            if (lost := self._gaps.of_peak(i, j)) is not None:
                end &= ~lost[1:]  # there is a row, which tells as much as a peak
            ends += int(end.sum())
            shown += int((peak[1:][end] > 0).sum())
        share = (SHOWN if dt < COARSE else SHOWN_COARSELY) * (1 - step / dt)
        return shown > 0 and shown >= share * ends

    def recorded(self, i: int, j: int) -> NDArray[np.bool_]:
        """(T,) true where a contact of theirs was recorded, of whatever force."""
        found = np.zeros(self._frames, np.bool_)
        found[self._episode.contacts.of_pair((min(i, j), max(i, j)), "frame")[0]] = True
        return found

    def upward(self, on: int, by: int) -> F64:
        """(T,) N, vertical component (up positive) of the total force on one body by another."""
        key = (min(on, by), max(on, by))
        if key not in self._vertical:
            self._vertical[key] = self._add_upward(key)
        return self._vertical[key] if on > by else -self._vertical[key]

    def _add_upward(self, key: Pair) -> F64:
        self.normal(*key)  # looks whether the contacts are sound
        frame, force = self._episode.contacts.of_pair(key, "frame", "force.z")
        return np.asarray(np.bincount(frame, force, self._frames), np.float64)

    def touching(self, i: int, j: int) -> NDArray[np.bool_]:
        """(T,) true where a force is exchanged."""
        return self.normal(i, j) > 0


def _along(a: NDArray[Any], b: NDArray[Any]) -> F64:
    """(N,) the product of vectors (N, 3) each."""
    return np.asarray(np.einsum("ij,ij->i", a, b, dtype=np.float64))


def strange(
    force: NDArray[Any], normal: NDArray[Any]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N,) forces along a normal that is not of unit length; (N,) forces that pull.

    Of a contact without force no normal is needed.
    """
    f, n = force.astype(np.float64), normal.astype(np.float64)
    some = (f != 0).any(axis=1)
    off = np.abs(np.einsum("ij,ij->i", n, n) - 1)
    along = np.einsum("ij,ij->i", f, n)
    least = -PULL * (1 + np.sqrt(np.einsum("ij,ij->i", f, f)))
    long, pulls = some & ~(off <= 2 * UNIT), some & ~(along >= least)
    if long.any():
        long &= ~(off <= 2 * (UNIT + min(most_off(normal), ROUNDED)))
    if pulls.any():
        least -= np.einsum("ij,ij->i", rounding_of(force).error(f), np.abs(n))
        least -= np.einsum("ij,ij->i", np.minimum(rounding_of(normal).error(n), ROUNDED), np.abs(f))
        pulls &= ~(along >= least)
    return long, pulls & ~long
