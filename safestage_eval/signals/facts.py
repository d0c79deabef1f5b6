"""What all signals of one episode are measured from: motion, shapes, forces, the initial state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.evidence.store import Store
from safestage_eval.geometry.extent import highest, lowest
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape

from .contact_sums import ContactSums
from .gaps import Gaps
from .options import Options, OptionValue
from .reference import Baseline, Reference
from .series import Series, unknown
from .settling import settled

F64 = NDArray[np.float64]


class Movers:
    """The bodies of an episode as shapes along their poses, built when first asked for."""

    def __init__(self, episode: Episode) -> None:
        """Nothing is loaded yet."""
        self._episode = episode
        self._movers: dict[str, Mover] = {}
        self._lowest: dict[str, F64] = {}
        self._highest: dict[str, F64] = {}

    def __getitem__(self, name: str) -> Mover:
        """The body's shape and poses (one pose for a fixed body)."""
        if name not in self._movers:
            track = self._episode.tracks[name]
            shape = BodyShape.build(self._episode.bodies[name], self._episode.meshes)
            self._movers[name] = Mover.build(shape, track.position, track.orientation)
        return self._movers[name]

    def lowest(self, name: str) -> F64:
        """(T,) m, or (1,) of a fixed body: world z of its lowest point."""
        if name not in self._lowest:
            self._lowest[name] = lowest(self[name])
        return self._lowest[name]

    def highest(self, name: str) -> F64:
        """(T,) m, or (1,) of a fixed body: world z of its highest point."""
        if name not in self._highest:
            self._highest[name] = highest(self[name])
        return self._highest[name]

    def of(self, names: Sequence[str]) -> list[Mover]:
        """Those of the bodies that have geometry."""
        return [self[name] for name in names if self._episode.bodies[name].geoms]

    def unseen(self, names: Sequence[str]) -> list[str]:
        """Those whose geometry is missing; a mere frame has none to miss."""
        return [name for name in names if self._episode.bodies[name].unseen]


class Facts:
    """An episode, and what several signals share."""

    def __init__(
        self,
        episode: Episode,
        baseline_frames: int = 5,
        backend: str = "gjk",
        store: Store | None = None,
    ) -> None:
        """Measure nothing yet.

        Args:
            episode: what is measured.
            baseline_frames: how many first frames estimate the initial state.
            backend: that measures clearances (``geometry.backend``).
            store: that answers queries about the episode; a new one in memory if None.
        """
        self.store = Store() if store is None else store
        self.gaps = Gaps(episode)
        self.episode = episode = self.gaps.episode
        self.backend = backend
        self.baseline = Baseline(baseline_frames)
        self.movers = Movers(episode)
        self._unions: dict[str, list[str]] = {}
        self._baselines: dict[str, Baseline] = {}
        self.untouched: Callable[[str], int] | None = None
        """Up to which frame the robot has certainly had nothing to do with a body."""

    @cached_property
    def contact_sums(self) -> ContactSums:
        """Forces summed per pair of bodies."""
        return ContactSums(self.episode, self.gaps, self.store)

    def baseline_of(self, name: str) -> Baseline:
        """Where the initial state of a body is estimated: the first frames in which it rests."""
        if name not in self._baselines:
            found = self.baseline
            if self.untouched is not None and name in self.episode.bodies:
                found = settled(self.episode, name, found, self.untouched)
            self._baselines[name] = found
        return self._baselines[name]

    def bodies(self, name: str) -> list[str]:
        """The bodies a name stands for: itself, or those of the union ``robot`` or ``gripper``.

        An immobile base of the robot is a fixture and in no union.
        """
        if name in self.episode.bodies:
            return [name]
        if name not in self._unions:
            kinds = {"robot": ("robot", "gripper"), "gripper": ("gripper",)}[name]
            self._unions[name] = [
                body.name
                for body in self.episode.header.bodies
                if body.kind in kinds and body.movable
            ]
        return self._unions[name]


class Query(NamedTuple):
    """One signal that is asked for.

    Attributes:
        facts: what it is measured from.
        name: of the built-in signal.
        dimension: of its value.
        bodies: names of bodies or unions, in the signal's order.
        groups: the same, each as the bodies that it stands for; none of them empty.
        since: what a change is measured from; None for the baseline.
        cap: m, for clearances: distances up to here are wanted exactly.
        deep: for clearances: depths of penetration are wanted as well.
        slack: m, for clearances: how much wider the bounds may be.
        options: what the signal's definition adds.
    """

    facts: Facts
    name: str
    dimension: str
    bodies: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    since: Reference | None
    cap: float
    deep: bool
    slack: float
    options: Options

    @property
    def episode(self) -> Episode:
        """The episode."""
        return self.facts.episode

    @property
    def reference(self) -> Reference:
        """What a change is measured from."""
        baseline = self.facts.baseline_of(self.bodies[0])
        if self.since is None:
            return Reference(baseline)
        return self.since if not baseline.start else replace(self.since, baseline=baseline)

    def option(self, name: str) -> OptionValue | None:
        """The value of an option, None if it was not given."""
        return dict(self.options).get(name)

    def unknown(self, why: str) -> Series:
        """Nothing is known of it, and why."""
        return unknown(len(self.facts.episode), self.dimension, why)
