"""Piles as they are at some frames, gathered from the recording."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.body import IDENTITY
from safestage_eval.episode.contacts import Pair
from safestage_eval.geometry.pose import matrix

from .arrangement import Arrangement
from .assembly import Assemblies
from .collapse import Pile
from .near import NOTHING, Patch, by_frame
from .statics import ARM

F64 = NDArray[np.float64]
Frames = NDArray[np.intp]

Touching = tuple[Patch, NDArray[np.int64]]
"""Points in which two bodies touch at F frames, by frame, and how many (F,) there are at each."""
Contacts = dict[Pair, Touching]


class Gathering:
    """Contact points and masses; bodies are indices into ``header.bodies``.

    The parts of an object that are jointed together are one rigid body; of two geoms in contact the
    greater friction counts, as in MuJoCo.
    """

    def __init__(self, episode: Episode, assemblies: Assemblies, arrangement: Arrangement) -> None:
        """Nothing is read before it is asked for."""
        self._episode = episode
        self._assemblies = assemblies
        self._arrangement = arrangement

    def head(self, body: int) -> int:
        """The part that stands for the object that a body is a part of; the body if it is not free."""
        free = self._assemblies.free
        return min(self._assemblies.of(body) & free) if body in free else body

    def contacts(self, frames: Frames, pairs: Iterable[Pair]) -> Contacts:
        """Those that exchange a force; only of pairs that have some."""
        contacts = {}
        for pair in pairs:
            starts = self._arrangement.starts(pair)
            first = starts[frames]
            many = starts[frames + 1] - first
            stop = np.cumsum(many)
            if stop[-1]:
                at = np.arange(stop[-1]) + np.repeat(first - stop + many, many)
                contacts[pair] = self._arrangement.points(pair, at), many
        return contacts

    @staticmethod
    def together(one: Touching, other: Touching) -> Touching:
        """Points of both, by frame."""
        (first, many), (second, more) = one, other
        frames = np.arange(len(many))
        at = np.concatenate([np.repeat(frames, many), np.repeat(frames, more)])
        return by_frame([first, second], at, len(many))

    def pile(self, heads: list[int], contacts: Contacts, frames: Frames) -> Pile:
        """The objects that ``heads`` stand for, and their contacts, at frames (F,)."""
        owner, part = {}, {}
        for k, head in enumerate(heads):
            parts = self._assemblies.of(head)
            part.update(dict.fromkeys(parts, k))
            owner.update(dict.fromkeys(parts & self._assemblies.free, k))
        owners, parts_of = (
            np.array([at.get(b, -1) for pair in contacts for b in pair], np.int64).reshape(-1, 2)
            for at in (owner, part)
        )
        many = np.zeros((len(contacts), 1 + len(frames)), np.int64)
        for row, (_, count) in zip(many, contacts.values(), strict=True):
            row[1:] = count
        start = many.cumsum().reshape(many.shape)
        points = [*(patch for patch, _ in contacts.values()), NOTHING]
        mass, centre, inertia = zip(*(self._body(head, frames) for head in heads), strict=True)
        return Pile(
            np.array(mass),
            np.stack(centre, 1),
            np.stack(inertia, 1),
            owners,
            parts_of,
            start,
            *map(np.concatenate, zip(*points, strict=True)),
        )

    def _body(self, head: int, frames: Frames) -> tuple[float, F64, F64]:
        """Mass (kg), centre (F, 3) m and inertia (F, 3, 3) kg m² about it of an object."""
        parts = sorted(self._assemblies.of(head) & self._assemblies.free)
        masses = [max(self._episode.header.bodies[p].mass or 0.0, 1e-9) for p in parts]
        inertias = [self._inertia(p, m, frames) for p, m in zip(parts, masses, strict=True)]
        at = np.stack([self._arrangement.centre(p, frames) for p in parts])
        if len(parts) == 1:
            return masses[0], at[0], inertias[0]
        m = np.array(masses)
        middle = np.tensordot(m, at, 1) / m.sum()
        arms = at - middle
        across = np.einsum("p,pti,pti->t", m, arms, arms)[:, None, None] * np.eye(3)
        across -= np.einsum("p,pti,ptj->tij", m, arms, arms)
        return float(m.sum()), middle, sum(inertias) + across

    def _inertia(self, body: int, mass: float, frames: Frames) -> F64:
        """(F, 3, 3) kg m², about its centre of mass, world axes."""
        about = self._episode.header.bodies[body]
        if about.inertia is None or min(about.inertia) <= 0:
            return np.tile(mass * ARM**2 * np.eye(3), (len(frames), 1, 1))
        orientation = self._episode.tracks[about.name].orientation
        turn = matrix(orientation[frames if len(orientation) > 1 else np.zeros_like(frames)])
        if tuple(about.inertia_orientation) != IDENTITY:
            turn = turn @ matrix(np.asarray(about.inertia_orientation))
        return np.asarray((turn * about.inertia) @ turn.swapaxes(1, 2))
