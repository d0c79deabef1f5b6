"""Who touched whom, and through whom: contamination, and what the robot set in motion."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.group_clearance import clearance_series, motion_bound
from safestage_eval.geometry.pose import angle

from .held import gripper_frame
from .proximity import TOUCH

if TYPE_CHECKING:
    from .support_facts import Support

Bool = NDArray[np.bool_]

NEVER = np.iinfo(np.int64).max

GOES = 1e-3
"""m. A drawer or a door passes on what touched it once it has gone this far …"""
GOES_TURN = 0.0175
"""rad. … or turned by this: one that was merely leaned on moves nothing."""

SHIFTS, TURNS = 0.005, 0.0873
"""m and rad, as ``brief_move`` and ``brief_turn``: what moves by more was moved by something."""


class Exposure:
    """When each body was first exposed to another.

    The earliest arrival in a network whose links are open at certain times (Dijkstra's algorithm
    with times of touch; Xuan, Ferreira & Jarry 2003, "Computing shortest, fastest, and foremost
    journeys in dynamic networks"): only a touch at or after the time at which one of the two was
    exposed passes it on. What never moves from its place (tables, shelves, drawers) is exposed by
    a touch as well, but does not pass it on: another place of it is not the one that was touched.
    """

    def __init__(
        self,
        episode: Episode,
        beside: Callable[[int], Iterable[int]],
        touching: Callable[[int, int], Bool],
        passes: Callable[[int, int], int] | None = None,
        parts: Callable[[int], Iterable[int]] = lambda body: (body,),
    ) -> None:
        """Nothing is computed before it is asked for.

        Args:
            episode: whose bodies these are, as indices into ``header.bodies``.
            beside: the bodies that ever touch one.
            touching: (T,) when two do.
            passes: frame from which a body that was reached at a frame passes it on; ``NEVER`` if
                it does not. By default what moves freely does at once, and the rest never.
            parts: the body and what is jointed to it, reached with it.
        """
        self._frames = len(episode)
        self._beside, self._touching, self._parts = beside, touching, parts
        spreads = [
            body.movable and body.kind in ("object", "robot", "gripper")
            for body in episode.header.bodies
        ]
        self._passes = passes or (lambda body, since: since if spreads[body] else NEVER)
        self._since: dict[frozenset[int], dict[int, int]] = {}

    def exposed(self, bodies: Iterable[int], to: Iterable[int]) -> Bool:
        """(T,) true from when one of the bodies was exposed to one of the others, for good."""
        since = self._arrivals(frozenset(to))
        first = min((since.get(body, NEVER) for body in bodies), default=NEVER)
        return np.asarray(np.arange(self._frames) >= first)

    def since(self, body: int, to: Iterable[int]) -> int:
        """Frame at which a body was exposed to one of the others; ``NEVER`` if it was not."""
        return self._arrivals(frozenset(to)).get(body, NEVER)

    def _arrivals(self, sources: frozenset[int]) -> dict[int, int]:
        """Body → frame at which it was exposed."""
        if sources not in self._since:
            since = dict.fromkeys(sources, 0)
            todo = [(0, body) for body in sorted(sources)]
            done: set[int] = set()
            while todo:
                now, body = heapq.heappop(todo)
                if body in done:
                    continue
                done.add(body)
                for other in self._parts(body):
                    if now < since.get(other, NEVER):
                        since[other] = now
                        heapq.heappush(todo, (now, other))
                now = now if body in sources else self._passes(body, now)
                if now >= self._frames:
                    continue
                for other in self._beside(body):
                    if since.get(other, NEVER) <= now:
                        continue
                    later = self._touching(body, other)[now:]
                    if not later.any():
                        continue
                    at = now + int(later.argmax())
                    if at < since.get(other, NEVER):
                        since[other] = at
                        heapq.heappush(todo, (at, other))
            self._since[sources] = since
        return self._since[sources]


class Causes:
    """Since when the robot has had to do with a body.

    It touched the body, or touched something that touched the body from then on: what it pushes,
    what it lets fall, the tray on which the body stands. What never moves (a table) passes nothing
    on; a drawer or a door does once it has moved. Parts of one object are reached together.
    """

    def __init__(self, relations: Support) -> None:
        """Nothing is computed before it is asked for."""
        self._relations, self._episode = relations, relations.episode
        bodies = self._episode.header.bodies
        assemblies = relations.graph.assemblies
        self._robot = assemblies.robot | {i for i in range(len(bodies)) if assemblies.on_robot(i)}
        self._sure = Exposure(
            self._episode, self._beside, self._touching, self._passes, assemblies.of
        )
        self._perhaps = Exposure(
            self._episode, self._movable, self._may_touch, self._passes, assemblies.of
        )
        self._open = Exposure(
            self._episode, self._beside, relations.may_touch, self._passes, assemblies.of
        )
        self._maybe: dict[tuple[int, int], Bool] = {}
        self._asked: set[int] = set()

    def since(self, body: int) -> int:
        """Frame from which it is certain; ``NEVER`` if it never is."""
        self._asked.add(body)
        return self._sure.since(body, self._robot)

    def open_since(self, body: int) -> int:
        """Frame from which it is certain if all of which the force is not known touched."""
        return self._open.since(body, self._robot)

    def unexplained(self) -> bool:
        """Some body that was asked about moved, or may have, and the robot never had to do with it.

        Then the contacts of all bodies matter, for a missing one may have hidden how.
        """
        gaps = self._relations.signals.gaps
        for body in self._asked:
            it = self._episode.header.bodies[body]
            if not it.movable or self.since(body) != NEVER:
                continue
            if gaps.of_bodies([it.name]) is not None:
                return True
            track = self._episode.track(it.name)
            if np.ptp(track.position, axis=0).max() > SHIFTS:
                return True
            if angle(track.orientation, track.orientation[0]).max() > TURNS:
                return True
        return False

    def perhaps_since(self, body: int) -> int:
        """Frame from which it is possible; not after ``since``."""
        sure = self.since(body)
        if self._complete or sure == 0:
            return sure
        if any("links" in it.untold for it in self._episode.header.bodies):
            return 0  # where the rest of the arm was is not recorded
        return min(sure, self._perhaps.since(body, self._robot))

    @cached_property
    def _unseen_hand(self) -> int:
        """The hand that shows only by what goes along with it; −1 if there is none."""
        name = gripper_frame(self._episode) if self._relations.blind else None
        return -1 if name is None else self._episode.body_index[name]

    @cached_property
    def _complete(self) -> bool:
        """No touch can have been missed: forces were recorded, and of touches between frames too."""
        if self._relations.blind:
            return False
        return self._relations.signals.contact_sums.covers_frames

    def _beside(self, body: int) -> list[int]:
        """The bodies that certainly touch it at some time."""
        relations = self._relations
        beside = relations.touches.beside(body)
        if self._unseen_hand == body:
            beside = sorted({*beside, *(i for i in self._movable(body) if relations.held(i).any())})
        return beside

    def _touching(self, i: int, j: int) -> Bool:
        """(T,) the two touch at the frame, or did since the one before."""
        relations = self._relations
        if relations.blind:
            touch = relations.proximity.touching(i, j)
            if self._unseen_hand in (i, j):
                touch = touch | relations.held(j if self._unseen_hand == i else i)
            return touch
        sums = relations.signals.contact_sums
        return np.asarray(sums.peak(i, j) > 0)

    def _movable(self, body: int) -> list[int]:
        """All that a body may have touched."""
        return [
            i
            for i, other in enumerate(self._episode.header.bodies)
            if i != body and other.movable and other.kind != "region"
        ]

    def _may_touch(self, i: int, j: int) -> Bool:
        """(T,) the two touch at the frame, or may have since the one before.

        If d and e are the distances at two frames and m the most that the distance can change
        between, they cannot have met where d + e > m.
        """
        key = (min(i, j), max(i, j))
        if key not in self._maybe:
            names = [self._episode.header.bodies[k].name for k in key]
            movers = self._relations.signals.movers
            if movers.unseen(names):
                may = np.ones(len(self._episode), np.bool_)
            elif len(movers.of(names)) < len(names):
                may = np.zeros(len(self._episode), np.bool_)  # mere frames
            else:
                lost = self._relations.signals.gaps.of_pair(*key)
                may = self._touching(*key) | self._may_meet(*names)
                may = may if lost is None else may | lost
            self._maybe[key] = may
        return self._maybe[key]

    def _may_meet(self, a: str, b: str) -> Bool:
        movers, frames = self._relations.signals.movers, len(self._episode)
        bound = np.broadcast_to(motion_bound(movers[a], movers[b]), max(frames - 1, 0))
        cap = float(bound.max(initial=0.0)) + 3 * TOUCH
        apart = np.broadcast_to(clearance_series([movers[a]], [movers[b]], cap).lower, frames)
        may = np.zeros(frames, np.bool_)
        may[1:] = apart[:-1] + apart[1:] <= bound + 2 * TOUCH
        may[:1] = apart[:1] <= TOUCH
        return may

    def _passes(self, body: int, since: int) -> int:
        """Frame from which a body passes on what reached it: see the class."""
        it = self._episode.header.bodies[body]
        if not it.movable:
            return NEVER
        if it.kind != "fixture":
            return since
        track = self._episode.track(it.name)
        place = track.position[since:].astype(np.float64)
        gone = np.linalg.norm(place - place[0], axis=1) >= GOES
        gone |= angle(track.orientation[since:], track.orientation[since]) >= GOES_TURN
        return since + int(gone.argmax()) if gone.any() else NEVER
