"""Who touched whom, and through whom: contamination, and what the robot set in motion."""

from __future__ import annotations

import heapq
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.pose import angle

from .worlds import World

Bool = NDArray[np.bool_]

NEVER = np.iinfo(np.int64).max

GOES = 1e-3
"""m. A drawer or a door passes on what touched it once it has gone this far …"""
GOES_TURN = 0.0175
"""rad. … or turned by this: one that was merely leaned on moves nothing."""


class Exposure:
    """When each body was first exposed to another, by the touches of a world.

    The earliest arrival in a network whose links are open at certain times (Dijkstra's algorithm
    with times of touch; Xuan, Ferreira & Jarry 2003, "Computing shortest, fastest, and foremost
    journeys in dynamic networks"): only a touch at or after the time at which one of the two was
    exposed passes it on. What never moves from its place (a table, a shelf) is exposed by a touch as
    well, but does not pass it on: another place of it is not the one that was touched.
    """

    def __init__(self, world: World, *, moves: bool) -> None:
        """``moves``: it is about what the robot set in motion.

        Parts of one object are reached together then, and a drawer or a door passes on what reached
        it once it has moved.
        """
        self._world, self._moves = world, moves
        self._since: dict[frozenset[int], dict[int, int]] = {}

    def since(self, bodies: Iterable[int], to: Iterable[int]) -> int:
        """Frame at which one of the bodies was exposed to one of the others; ``NEVER`` if none was."""
        known = self._arrivals(frozenset(to))
        return min((known.get(body, NEVER) for body in bodies), default=NEVER)

    def _arrivals(self, sources: frozenset[int]) -> dict[int, int]:
        """Body → frame at which it was exposed."""
        if sources in self._since:
            return self._since[sources]
        world, since = self._world, dict.fromkeys(sources, 0)
        todo, done = [(0, body) for body in sorted(sources)], set[int]()
        while todo:
            now, body = heapq.heappop(todo)
            if body in done:
                continue
            done.add(body)
            reached = {other: now for other in world.graph.assemblies.of(body) if self._moves}
            now = now if body in sources else self._passes(body, now)
            if now < world.frames:
                for other in world.met(body):
                    if now < since.get(other, NEVER):
                        later = world.touching(body, other)[now:]
                        if later.any():
                            at = now + int(later.argmax())
                            reached[other] = min(at, reached.get(other, NEVER))
            for other, at in reached.items():
                if at < since.get(other, NEVER):
                    since[other] = at
                    heapq.heappush(todo, (at, other))
        self._since[sources] = since
        return since

    def _passes(self, body: int, since: int) -> int:
        """Frame from which a body passes on what reached it."""
        it = self._world.episode.header.bodies[body]
        if it.movable and it.kind in ("object", "robot", "gripper"):
            return since
        if not (self._moves and it.movable):
            return NEVER
        if it.kind != "fixture":
            return since
        track = self._world.episode.track(it.name)
        place = track.position[since:].astype(np.float64)
        gone = np.linalg.norm(place - place[0], axis=1) >= GOES
        gone |= angle(track.orientation[since:], track.orientation[since]) >= GOES_TURN
        return since + int(gone.argmax()) if gone.any() else NEVER
