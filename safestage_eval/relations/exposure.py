"""Contamination: what touched a body, or touched what had touched it."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode

NEVER = np.iinfo(np.int64).max


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
        touching: Callable[[int, int], NDArray[np.bool_]],
    ) -> None:
        """``beside``: the bodies that ever touch one; ``touching``: (T,) when two do."""
        self._frames = len(episode)
        self._beside, self._touching = beside, touching
        self._spreads = [
            body.movable and body.kind in ("object", "robot", "gripper")
            for body in episode.header.bodies
        ]
        self._since: dict[frozenset[int], dict[int, int]] = {}

    def exposed(self, bodies: Iterable[int], to: Iterable[int]) -> NDArray[np.bool_]:
        """(T,) true from when one of the bodies was exposed to one of the others, for good."""
        since = self._arrivals(frozenset(to))
        first = min((since.get(body, NEVER) for body in bodies), default=NEVER)
        return np.asarray(np.arange(self._frames) >= first)

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
                if not (self._spreads[body] or body in sources):
                    continue
                for other in self._beside(body):
                    later = self._touching(body, other)[now:]
                    if not later.any():
                        continue
                    at = now + int(later.argmax())
                    if at < since.get(other, NEVER):
                        since[other] = at
                        heapq.heappush(todo, (at, other))
            self._since[sources] = since
        return self._since[sources]
