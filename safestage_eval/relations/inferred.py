"""Touches, support and grips made up from shapes, for recordings without contact forces.

What is within 1 mm touches, with any force; what bears a body shows when it is lifted. A grip shows
by fingers on two sides, or by what goes along with the hand. Where shapes do not tell whether a body
stands or hangs from a hand, it does either.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.runs import runs
from safestage_eval.geometry.pose import angle, matrix

from .held import Grip, by_fingers, by_motion, gripper_frame
from .proximity import TOUCH
from .worlds import World

if TYPE_CHECKING:
    from .support_facts import Support

STAYS = (1e-3, np.radians(1.0))
"""m, rad: what has moved by less still stands where it stood, also in a hand."""
RISES = 1e-5
"""m. What presses on its support as deep as when it stood there by itself, but for this, is borne by it."""
LEAVES = 0.2
"""s. What is lifted is off what it stood on sooner; what takes longer may hang or stand all the while."""

Bool = NDArray[np.bool_]


class Hands:
    """What hands may hold, and take away, by shapes and motion alone."""

    def __init__(self, facts: Support) -> None:
        """Nothing is computed before it is asked for."""
        self._facts = facts
        self._grips: dict[int, Grip] = {}
        self._taken: dict[int, Bool] = {}

    def grip(self, body: int) -> Grip:
        """Whether one holds a body: by its fingers, or where their shapes are not known by its motion."""
        if body not in self._grips:
            self._grips[body] = self._grip(body)
        return self._grips[body]

    def _grip(self, body: int) -> Grip:
        facts = self._facts
        if facts.fingers_seen and facts.episode.header.bodies[body].geoms:
            return by_fingers(facts.episode, body, facts.proximity)
        if facts.hand is None or not facts.episode.header.bodies[body].movable:
            nothing = np.zeros(len(facts.episode), np.bool_)
            return Grip(nothing, nothing, nothing)
        return by_motion(facts.episode, body, facts.hand, facts.borne(body))

    def take_along(self, body: int) -> Bool:
        """(T,) a hand may be taking it away, and it still touches what it stood on.

        From when it is no longer where it stood before the hand can have had it, until it is off, unless
        that is soon. What never comes off while the hand may have it does not hang from it as long as it
        slides upright on what bore it there, as deep as then.
        """
        if body not in self._taken:
            self._taken[body] = self._take_along(self._facts, body)
        return self._taken[body]

    def _take_along(self, facts: Support, body: int) -> Bool:
        held = self.grip(body).perhaps
        track = facts.episode.track(facts.episode.header.bodies[body].name)
        borne = facts.graph.supported(body)
        out = np.zeros(len(held), np.bool_)
        for start, end in runs(held) if len(track) == len(held) else ():
            stop = start + int(np.append(borne[start:end], False).argmin())
            before = max(start - 1, 0)
            position, orientation = track.position[start:stop], track.orientation[start:stop]
            gone = np.linalg.norm(position - track.position[before], axis=1) > STAYS[0]
            gone |= angle(orientation, track.orientation[before]) > STAYS[1]
            if start > 0 and stop == end:  # how it stood without the hand is known, and it stays on
                rows = start + np.flatnonzero(gone)
                gone[rows - start] = ~_slides(facts, body, before, rows)
            first = start + int(np.append(gone, True).argmax())
            if facts.episode.clock.seconds(first, stop) >= LEAVES:
                out[first:stop] = True
        return out


class Inferred(World):
    """By the distances of shapes: who has none, or whose pose was not measured, may be anywhere."""

    complete = False

    def __init__(self, facts: Support, hands: Hands, *, most: bool) -> None:
        """As ``World``; ``hands``: the same of both worlds."""
        super().__init__(facts, most=most)
        self._hands = hands
        self._near = facts.proximity
        self._names = [body.name for body in self.episode.header.bodies]
        self._solid = [i for i, b in enumerate(self.episode.header.bodies) if b.kind != "region"]

    def _lost(self, i: int, j: int) -> Bool | None:
        """(T,) where it is not known where the two are, or which shape one has; None if nowhere."""
        names, gaps = [self._names[i], self._names[j]], self.facts.signals.gaps
        for body in names:
            if self.facts.signals.movers.unseen([body]) and not self._of_robot(body):
                return np.ones(self.frames, np.bool_)
        return gaps.of_bodies(names, unseen=False)

    def _of_robot(self, name: str) -> bool:
        return self.episode.bodies[name].kind in ("robot", "gripper")

    def beside(self, body: int) -> list[int]:
        """See ``World``."""
        near = self._near.beside(body)
        if not self.most:
            return near
        lost = (i for i in self._solid if i != body and self._lost(body, i) is not None)
        return sorted({*near, *lost})

    def near(self, i: int, j: int) -> Bool:
        """See ``World``."""
        near = self.bound(self._near.touching(i, j), self._lost(i, j))
        for hand, other in ((i, j), (j, i)):
            if hand == self._hand:
                near = near | self.held(other)
        return near

    @cached_property
    def _hand(self) -> int:
        """The hand that shows only by what goes along with it; −1 if there is none."""
        name = gripper_frame(self.episode)
        return -1 if name is None else self.episode.body_index[name]

    def met(self, body: int) -> list[int]:
        """See ``World``."""
        if self.most:
            return super().met(body)
        # whether they ever did is not asked here: of most it does not matter, and it is costly
        bodies, hand = self.episode.header.bodies, self._hand
        seen = (i for i in self._solid if body == hand or i != hand or bodies[i].geoms)
        return [i for i in seen if i != body]

    def bears(self, bearer: int, borne: int) -> Bool:
        """See ``World``."""
        bears = self.bound(self._near.bears(bearer, borne), self._lost(bearer, borne))
        return bears if self.most or not bears.any() else bears & ~self._hands.take_along(borne)

    def lifted(self, body: int, by: Iterable[int], held: Bool) -> Bool:
        """See ``World``."""
        by = list(by)
        lifted = self._near.lifted(body, by, held)
        for other in by:
            lifted = self.bound(lifted, self._lost(body, other))
        return lifted

    def grip(self, body: int) -> Bool:
        """See ``World``."""
        grip = self._hands.grip(body)
        gripper = self.facts.signals.bodies("gripper")
        lost = self.facts.signals.gaps.of_bodies([self._names[body], *gripper], unseen=False)
        return self.bound(grip.perhaps if self.most else grip.sure, lost)

    def grasped(self, body: int) -> Bool:
        """See ``World``."""
        return self.held(body) | self._hands.grip(body).grasped if self.most else self.held(body)

    def carried(self, body: int) -> Bool:
        """As by forces, and where fingers hold it and nothing else supports it.

        Friction lifts what they squeeze, and no shape shows it.
        """
        carried = super().carried(body) | (self.held(body) & ~self.facts.borne(body))
        return carried | self._hands.take_along(body) if self.most else carried

    def leaned_on(self, body: int) -> Bool:
        """See ``World``: what touches may press; what goes into it does."""
        total = np.zeros(self.frames, np.bool_)
        if self.most and self.facts.lacks_shapes_of_robot():
            return ~total
        for other, has in self.hands_at(body).items():
            near = has & self.bound(self._near.touching(body, other), self._lost(body, other))
            rows = np.flatnonzero(near)
            if self.most:
                total |= near
            elif len(rows):
                total[rows] |= self._near.gap(body, other, rows).upper < -TOUCH
        return total

    def hangs_on(self, body: int, on: int) -> Bool:
        """(T,) it falls without the other: it rests on it, past nothing that is held.

        What leans on a can falls with what the can stands on, and what stands on a board may be the
        weight without which it tips: at the most a chain of touches joins the two, over objects that
        nothing holds. At the least no other path of support leads down.
        """
        other = self.other
        rests = self.graph.rests_on(body, on, other.held)
        if not self.most:
            return rests & ~other.graph.supported_without(body, on)
        bodies = self.episode.header.bodies
        may, todo = {on: np.ones(self.frames, np.bool_)}, [on]
        while todo:
            lower = todo.pop()
            through = may[lower] if lower == on else may[lower] & ~other.held(lower)
            for upper in self.beside(lower):
                free = bodies[upper].kind == "object" and bodies[upper].movable
                if upper == on or (upper != body and (lower == body or not free)):
                    continue
                touching = self.bound(self._near.touching(upper, lower), self._lost(upper, lower))
                before = may.get(upper, np.zeros(self.frames, np.bool_))
                if (through & touching & ~before).any():
                    may[upper] = before | (through & touching)
                    todo.append(upper)
        return rests | may.get(body, np.zeros(self.frames, np.bool_))


def _slides(facts: Support, body: int, before: int, rows: NDArray[np.intp]) -> Bool:
    """(N,) it is as upright on something as it was ``before``, and presses on it as it did."""
    name = facts.episode.header.bodies[body].name
    turned = matrix(facts.episode.track(name).orientation[[before, *rows]])
    up = np.einsum("nij,j->ni", turned, turned[0].T @ (0.0, 0.0, 1.0))
    upright = np.flatnonzero(up[1:, 2] >= np.cos(STAYS[1]))
    out = np.zeros(len(rows), np.bool_)
    for bearer, bears in facts.graph.bearers(body).items():
        at = upright[bears[rows[upright]]] if bears[before] else upright[:0]
        if len(at):
            then = facts.proximity.gap(body, bearer, np.array([before]))
            now = facts.proximity.gap(body, bearer, rows[at])
            out[at] |= now.upper <= then.lower + RISES
    return out


def inferred(facts: Support) -> World:
    """The greatest world of a recording without forces."""
    hands = Hands(facts)
    least, most = (Inferred(facts, hands, most=end) for end in (False, True))
    least.other, most.other = most, least
    return most
