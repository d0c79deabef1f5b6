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
        held = next((found for found in self._piles if found not in others), None)
        while held is None and self._held < self._most:
            found = self._next()
            if found is None:
                break
            held = None if found in others else found
        return held

    def _next(self) -> Place | None:
        """Hold one more; where it is."""
        episode = None if self._ended else next(self._rest, None)
        if episode is None:
            self._ended = True
            return None
        found = place(episode)
        self._piles.setdefault(found, deque()).append(episode)
        self._held += 1
        return found

    def _draw(self, found: Place, count: int) -> list[Numbered]:
        """The first ones of a file."""
        pile = self._piles[found]
        while len(pile) < count and self._next() == found:
            pass
        taken = [pile.popleft() for _ in range(min(count, len(pile)))]
        if not pile:
            del self._piles[found]
        self._held -= len(taken)
        return taken

    def _shared(self, count: int) -> list[Numbered]:
        """The first half of what another process has before it, the most of them all."""
        if not self._piles:
            return []
        found = max(self._piles, key=lambda found: len(self._piles[found]))
        return self._draw(found, min(count, -(-len(self._piles[found]) // 2)))
