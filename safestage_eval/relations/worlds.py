"""Who touches, bears and holds whom, at the least and at the most that a recording allows.

Whatever only grows with touches, loads and grips lies between what it is in the two worlds; so
relations are decided in both, and nobody else asks what was not recorded.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .between import may_meet
from .graph import LEAST_SHARE, ByForce, SupportGraph
from .held import by_pressure, may_differ

if TYPE_CHECKING:
    from .support_facts import Support

Bool = NDArray[np.bool_]

PRESSED = 0.1
"""N. Whoever presses on a body with this, as much as a contact takes, has a hand in how it stands."""


class World:
    """One of the two worlds; bodies are indices into ``header.bodies``, answers (T,).

    Attributes:
        graph: who bears whom in it.
        most: it is the one with all that may be.
        other: the other one; the same where nothing is left open.
    """

    other: World

    def __init__(self, facts: Support, *, most: bool) -> None:
        """``facts``: of the episode; nothing is computed before it is asked for."""
        self.facts, self.most = facts, most
        self.episode, self.frames = facts.episode, len(facts.episode)
        self.graph = SupportGraph(facts.episode, self)
        self._held: dict[int, Bool] = {}
        self._meet: dict[tuple[int, int], Bool] = {}

    # ---- what differs with and without recorded forces

    @abstractmethod
    def beside(self, body: int) -> list[int]:
        """The bodies that ever touch one, ascending."""

    @abstractmethod
    def near(self, i: int, j: int) -> Bool:
        """The two touch at the frame, or did since the one before."""

    @abstractmethod
    def bears(self, bearer: int, borne: int) -> Bool:
        """The first, robot or not, bears the second."""

    @abstractmethod
    def lifted(self, body: int, by: Iterable[int], held: Bool) -> Bool:
        """The others together bear it; where it is ``held`` it may stay open."""

    @abstractmethod
    def grip(self, body: int) -> Bool:
        """Fingers hold it."""

    @abstractmethod
    def leaned_on(self, body: int) -> Bool:
        """The robot, and what it has, press on a body."""

    @property
    @abstractmethod
    def complete(self) -> bool:
        """No touch between two frames can have been missed."""

    # ---- what does not

    def bound(self, truth: Bool, lost: Bool | None) -> Bool:
        """Something, where it is ``lost`` (T,) whether it is so: it is at the most, and not at the least."""
        if lost is None:
            return truth
        return truth | lost if self.most else truth & ~lost

    def held(self, body: int) -> Bool:
        """A gripper holds it."""
        if body not in self._held:
            if self.facts.lacks_hand():
                self._held[body] = np.full(self.frames, self.most)
            else:
                self._held[body] = self.grip(body)
        return self._held[body]

    def grasped(self, body: int) -> Bool:
        """It is held, or about to be."""
        return self.held(body)

    def carried(self, body: int) -> Bool:
        """A path of support leads from it to one that the robot holds."""
        return self.graph.carried(body, self.held)

    def hands_at(self, body: int) -> dict[int, Bool]:
        """Body → where the robot has it, of those that ever touch one: its own links always.

        What holds still (its base, a table) has nobody.
        """
        hands, assemblies = {}, self.graph.assemblies
        for other in self.beside(body):
            if other in assemblies.robot or assemblies.on_robot(other):
                hands[other] = np.ones(self.frames, np.bool_)
            elif other in assemblies.free:
                hands[other] = self.held(other) | self.graph.carried(other, self.held)
        return {other: has for other, has in hands.items() if has.any()}

    # ---- over time

    def met(self, body: int) -> list[int]:
        """All that a body may ever have touched, between frames too; ``touching`` tells when."""
        if not self.most or (self.complete and self.facts.signals.gaps.unseen is None):
            return self.beside(body)
        return [
            i
            for i, other in enumerate(self.episode.header.bodies)
            if i != body and other.movable and other.kind != "region"
        ]

    def touching(self, i: int, j: int) -> Bool:
        """The two touch at the frame, or since the one before, between frames and in holes too."""
        if not self.most:
            return self.near(i, j)
        key, unseen = (min(i, j), max(i, j)), self.facts.signals.gaps.unseen
        if key not in self._meet:
            touching = self.near(i, j)
            if not self.complete:
                touching = touching | may_meet(self.facts.signals, *key)
            self._meet[key] = touching if unseen is None else touching | unseen
        return self._meet[key]


class Recorded(World):
    """By the recorded forces: one that is not known is none, or any."""

    def __init__(self, facts: Support, *, most: bool) -> None:
        """As ``World``."""
        super().__init__(facts, most=most)
        self._sums = facts.signals.contact_sums
        self._force = ByForce(self.episode, self._sums, sure=not most)

    def beside(self, body: int) -> list[int]:
        """See ``World``."""
        return self._sums.beside(body)

    def near(self, i: int, j: int) -> Bool:
        """See ``World``."""
        touching = self._sums.peak(i, j) > 0
        lost = self._sums.touch_unknown(i, j) if self.most else None
        return touching if lost is None else touching | lost

    def bears(self, bearer: int, borne: int) -> Bool:
        """See ``World``."""
        return self.bound(self._force.bears(bearer, borne), self._sums.unknown(bearer, borne))

    def lifted(self, body: int, by: Iterable[int], held: Bool) -> Bool:
        """See ``World``."""
        by = list(by)
        lifted = self._force.lifted(body, by, held)
        for other in by:
            lifted = self.bound(lifted, self._sums.unknown(body, other))
        return lifted

    def grip(self, body: int) -> Bool:
        """See ``World``."""
        beside, bodies = self._sums.beside(body), self.episode.header.bodies
        held = by_pressure(self.episode, body, beside)
        for other in beside:
            lost = self._sums.unknown(body, other) if bodies[other].finger else None
            if lost is not None:
                held = self.bound(held, may_differ(self.episode, body, beside, lost, held))
        return held

    def leaned_on(self, body: int) -> Bool:
        """See ``World``."""
        total = np.zeros(self.frames)
        mass = self.episode.header.bodies[body].mass
        weight = (mass or 0.0) * float(np.linalg.norm(self.episode.header.gravity))
        for other, has in self.hands_at(body).items():
            force, lost = self._sums.normal(body, other), self._sums.unknown(body, other)
            if self.most and lost is not None:
                force = np.where(lost, np.inf, force)
            total += np.where(has, force, 0.0)
        return total >= min(PRESSED, LEAST_SHARE * weight or PRESSED)

    @property
    def complete(self) -> bool:
        """See ``World``."""
        return self._sums.covers_frames


def recorded(facts: Support) -> World:
    """The greatest world of a recording with forces."""
    sums, gaps = facts.signals.contact_sums, facts.signals.gaps
    for pair in sums.pairs:
        sums.normal(*pair)  # looks whether its contacts are sound
    most = least = Recorded(facts, most=True)
    unknown = gaps.of_contacts or gaps.unseen is not None or facts.unweighed or facts.faint
    if unknown or facts.lacks_hand() or not sums.covers_frames:
        least = Recorded(facts, most=False)
    most.other, least.other = least, most
    return most
