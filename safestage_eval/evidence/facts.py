"""Facts that all signals of one episode are measured from: motion, shapes, forces, the initial state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.extent import highest, lowest
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape

from . import motion
from .contact_sums import ContactSums
from .declare import Options, OptionValue, Signal
from .intervals import Interval, exact, unknown
from .missing_values import Gaps
from .reference import Baseline, Reference, settled

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
    ) -> None:
        """Measure nothing yet.

        Args:
            episode: what is measured.
            baseline_frames: how many first frames estimate the initial state, at most.
        """
        self.gaps = Gaps(episode)
        self.episode = episode = self.gaps.episode
        first = episode.clock.together(0, baseline_frames)
        self.baseline = Baseline(first, asked=baseline_frames)
        self.movers = Movers(episode)
        self._unions: dict[str, list[str]] = {}
        self._baselines: dict[str, Baseline] = {}
        self.untouched: Callable[[str], int] | None = None
        """Up to which frame the robot has certainly had nothing to do with a body."""

    @cached_property
    def contact_sums(self) -> ContactSums:
        """Forces summed per pair of bodies."""
        return ContactSums(self.episode, self.gaps)

    def com_position(self, name: str) -> F64:
        """(T, 3) m, centre of mass of a body, world."""
        return motion.com_position(self.episode, name)

    def com_velocity(self, name: str) -> tuple[F64, tuple[str, ...]]:
        """(T, 3) m/s, velocity of the centre of mass, world; and a note if it had to be derived."""
        return motion.com_velocity(self.episode, name)

    def angular_velocity(self, name: str) -> tuple[F64, tuple[str, ...]]:
        """(T, 3) rad/s, world; and a note if it had to be derived."""
        velocity, notes = motion.angular_velocity(self.episode, name)
        return velocity.astype(np.float64), notes

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

    def pairs_between(self, bodies: Sequence[str]) -> list[tuple[Mover, Mover]]:
        """Pairs of shapes, one of each of two unions; of none, those of the robot that may collide."""
        if not bodies:
            known = self.movers
            return [
                (known[a.name], known[b.name])
                for a, b in colliding_pairs(self.episode)
                if a.geoms and b.geoms
            ]
        first, second = (self.movers.of(self.bodies(body)) for body in bodies)
        return [(a, b) for a in first for b in second]


def colliding_pairs(episode: Episode) -> list[tuple[Body, Body]]:
    """The bodies of the robot that may collide with each other, each pair once.

    Not those that the model excludes, neighbours along a joint, the left and the right finger
    (they are made to meet), and two that never move.
    """
    parts = [body for body in episode.header.bodies if body.kind in ("robot", "gripper")]
    return [
        (a, b)
        for i, a in enumerate(parts)
        for b in parts[i + 1 :]
        if (a.movable or b.movable) and not _excluded(a, b)
    ]


def _excluded(a: Body, b: Body) -> bool:
    jointed = a.parent == b.name or b.parent == a.name
    excluded = b.name in a.excluded or a.name in b.excluded
    return jointed or excluded or {a.finger, b.finger} == {"left", "right"}


class Request(NamedTuple):
    """One signal to be measured.

    Attributes:
        facts: what it is measured from.
        signal: its declaration.
        dimension: of its value, with these options.
        bodies: names of bodies or unions, in the signal's order.
        groups: the same, each as the bodies that it stands for; none of them empty.
        since: what a change is measured from; None for the baseline.
        cap: m, for clearances: distances up to here must be exact.
        deep: for clearances: depths of penetration are needed as well.
        slack: m, for clearances: how much wider the bounds may be.
        options: what the signal's definition adds.
        relations: of the episode (``relations.Relations``), for a signal with ``support``.
        at: (N,) the frames at which a ``costly`` signal is measured; all frames of any other.
    """

    facts: Facts
    signal: Signal
    dimension: str
    bodies: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    since: Reference | None
    cap: float
    deep: bool
    slack: float
    options: Options
    relations: Any
    at: NDArray[np.int64]

    @property
    def name(self) -> str:
        """Name of the built-in signal."""
        return self.signal.name

    @property
    def episode(self) -> Episode:
        """The episode."""
        return self.facts.episode

    @property
    def reference(self) -> Reference:
        """Return the reference of a change."""
        baseline = self.facts.baseline_of(self.bodies[0])
        if self.since is None:
            return Reference(baseline)
        return self.since if not baseline.start else replace(self.since, baseline=baseline)

    def option(self, name: str) -> OptionValue | None:
        """The value of an option, None if it was not given."""
        return dict(self.options).get(name)

    def number(self, name: str) -> float:
        """The value of an option that is a number, or its default, in SI."""
        value = self.option(name)
        if not isinstance(value, float | int):
            value = next(option.default for option in self.signal.options if option.name == name)
        assert value is not None  # the option has a default
        return float(value)

    @property
    def over(self) -> float | None:
        """S before each frame that the value depends on; None if it looks at no such time."""
        return self.signal.looks_back(dict(self.options))

    @property
    def place(self) -> F64:
        """(T, 3) m, world: the first body's centre of mass, or the point that ``point`` names."""
        name = self.bodies[0]
        if self.option("point") == "origin":
            return self.episode.track(name).position.astype(np.float64)
        return self.facts.com_position(name)

    def shapes(self) -> list[list[Mover]] | Interval:
        """The bodies that have geometry, per argument; an unknown series where one has none."""
        movers = [self.facts.movers.of(group) for group in self.groups]
        bare = [" and ".join(g) for g, m in zip(self.groups, movers, strict=True) if not m]
        return self.unknown(f"the trace has no shape of {', '.join(bare)}") if bare else movers

    def least(self, value: Interval) -> Interval:
        """A least value over the parts of unions, unknown from below where some have no shape."""
        unseen = [name for group in self.groups for name in self.facts.movers.unseen(group)]
        return open_below(value, unseen)

    def exact(self, values: NDArray[Any], notes: tuple[str, ...] = ()) -> Interval:
        """A series that is known at every frame."""
        return exact(values, self.dimension, notes)

    def unknown(self, why: str) -> Interval:
        """A series that is unknown at every frame that is measured, and why."""
        return unknown(len(self.at), self.dimension, why)


def open_below(value: Interval, unseen: Sequence[str]) -> Interval:
    """A least distance, unknown from below because bodies without a shape may come closer."""
    if not unseen:
        return value
    note = (
        f"the trace has no shape of {', '.join(unseen)}: it may come closer than the rest "
        "(a mere frame is recorded with mass 0)"
    )
    return Interval(
        np.full(len(value), -np.inf), value.upper, value.dimension, (*value.notes, note)
    )
