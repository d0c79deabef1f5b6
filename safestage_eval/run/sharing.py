"""Which episodes a process is given next: neighbours in a file, as far as possible."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from pathlib import Path

from .engine_interface import Numbered

Place = tuple[Path, str | None]
"""The files that an episode is in."""

AHEAD = 128
"""Episodes per process that are looked at before their turn, at most, to find one in another file."""


def place(episode: Numbered) -> Place:
    """Where an episode is stored."""
    _, ref = episode
    return ref.path, ref.stored_in


class Shares:
    """Episodes sorted by the files they are in; only some files are held.

    Who opens a file reads what its end says, which of a shard takes as long as judging several
    of its episodes. So a file belongs to one process while there are others to be had.
    """

    def __init__(self, episodes: Iterator[Numbered], processes: int) -> None:
        """``episodes``: those of a file mostly one after the other."""
        self._rest, self._ended = episodes, False
        self._most = AHEAD * processes
        self._piles: dict[Place, deque[Numbered]] = {}
        self._held = 0

    def take(
        self, count: int, own: Place | None, others: Collection[Place | None]
    ) -> list[Numbered]:
        """The next ones for a process, at most ``count``; none when there are none left.

        Args:
            count: at least 1.
            own: the files from which the process had its last ones.
            others: those from which other processes had theirs.
        """
        taken: list[Numbered] = []
        others = set(others) - {own}
        while len(taken) < count:
            if own not in self._piles:
                own = self._free(others)
            if own is None:
                break
            taken += self._draw(own, count - len(taken))
        return taken or self._shared(count)

    def _free(self, others: Collection[Place | None]) -> Place | None:
        """Files that no other process has; the first such in order."""
        held = next((pile for pile in self._piles if pile not in others), None)
        while held is None and self._held < self._most:
            following = self._next()
            if following is None:
                break
            held = None if following in others else following
        return held

    def _next(self) -> Place | None:
        """Hold one more; where it is."""
        episode = None if self._ended else next(self._rest, None)
        if episode is None:
            self._ended = True
            return None
        place_of = place(episode)
        self._piles.setdefault(place_of, deque()).append(episode)
        self._held += 1
        return place_of

    def _draw(self, place: Place, count: int) -> list[Numbered]:
        """The first ones of a file."""
        pile = self._piles[place]
        while len(pile) < count and self._next() == place:
            pass
        taken = [pile.popleft() for _ in range(min(count, len(pile)))]
        if not pile:
            del self._piles[place]
        self._held -= len(taken)
        return taken

    def _shared(self, count: int) -> list[Numbered]:
        """The first half of what another process has before it, the most of them all."""
        if not self._piles:
            return []
        largest = max(self._piles, key=lambda pile: len(self._piles[pile]))
        return self._draw(largest, min(count, -(-len(self._piles[largest]) // 2)))
