"""A store for an episode that grows: answers of the frames so far are extended by the new ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .partial import Partial
from .query import Growth, Query
from .series import Series
from .store import Item, Store


class GrowingStore(Store):
    """Keeps what no later frame can change, and measures it at the new frames only."""

    def __init__(self) -> None:
        """Start without frames; ``grow`` comes first."""
        super().__init__()
        self.frames = 0
        self._stretch: Callable[[int, int], Any]
        self._grown: dict[Query, Any] = {}
        self._partials: dict[Query, Partial] = {}
        self._items: dict[Query, tuple[int, set[Any]]] = {}
        """Query → the number of frames looked at, and what occurred there."""

    def grow(self, frames: int, stretch: Callable[[int, int], Any]) -> None:
        """Go on to an episode of more frames; ``stretch`` gives relations of frames [first, last)."""
        self.frames, self._stretch = frames, stretch
        self._known.clear()

    def items(self, query: Query, measure: Callable[[Any], Iterable[Item]]) -> list[Item]:
        """Like the base class; only the new frames are looked at."""
        frames, found = self._items.get(query, (0, set()))
        if frames < self.frames:
            found |= set(measure(self._stretch(frames, self.frames)))
            self._items[query] = self.frames, found
        return sorted(found)

    def _answer(self, query: Query, measure: Callable[[Any], Any], growth: Growth) -> Any:
        if growth is Growth.PER_FRAME:
            return self._extended(query, measure)
        if query not in self._known:
            found = measure(None)
            self._known[query] = _open_end(found) if growth is Growth.OPEN_END else found
        return self._known[query]

    def _extended(self, query: Query, measure: Callable[[Any], Any]) -> Any:
        known = self._grown.get(query)
        frames = 0 if known is None else len(known)
        if frames < self.frames:
            more = measure(self._stretch(frames, self.frames))
            if more is None:  # what a trace lacks, it lacks at every frame
                return None
            known = self._grown[query] = more if known is None else _joined(known, more)
        return known

    def _partial(self, query: Query, frames: int) -> Partial:
        known = self._partials.get(query)
        if known is None or len(known.done) < frames:
            longer = Partial.blank(frames) if known is None else _longer(known, frames)
            self._partials[query] = longer
        return self._partials[query]

    def _measure_at(
        self,
        at: NDArray[np.int64],
        measure: Callable[[Any, NDArray[np.int64]], tuple[NDArray[np.int64], Series]],
        growth: Growth,
    ) -> tuple[NDArray[np.int64], Series]:
        if growth is not Growth.PER_FRAME:
            return measure(None, at)
        first = int(at.min())
        there, found = measure(self._stretch(first, self.frames), at - first)
        return there + first, found


def _joined(known: Any, more: Any) -> Any:
    """A series or column of the earlier frames and of the later ones, as one."""
    if not isinstance(known, Series):
        return np.concatenate([known, more])
    lower = np.concatenate([known.lower, more.lower])
    same = known.upper is known.lower and more.upper is more.lower
    upper = lower if same else np.concatenate([known.upper, more.upper])
    notes = tuple(dict.fromkeys(known.notes + more.notes))
    return Series(lower, upper, known.dimension, notes)


def _open_end(found: Series) -> Series:
    """Return the series; its last frame is open if a note says that its velocities were derived."""
    if not found.notes:
        return found
    lower, upper = found.lower.copy(), found.upper.copy()
    lower[-1:], upper[-1:] = -np.inf, np.inf
    return Series(lower, upper, found.dimension, found.notes)


def _longer(partial: Partial, frames: int) -> Partial:
    """Return the measurement over more frames; the new ones are missing."""
    found, before = Partial.blank(frames), len(partial.done)
    found.lower[:before], found.upper[:before] = partial.lower, partial.upper
    found.done[:before] = partial.done
    for note, about in partial.notes.items():
        found.notes[note] = np.zeros(frames, np.bool_)
        found.notes[note][:before] = about
    return found
