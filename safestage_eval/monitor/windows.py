"""Stretches of a recording that is still growing, with what is measured on each of them."""

from __future__ import annotations

from typing import Protocol

from safestage_eval.episode import Episode, Header
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations


class Recording(Protocol):
    """Frames so far, as ``formats.TraceWriter`` holds them."""

    @property
    def header(self) -> Header:
        """What is said once; the bodies are complete before the first frame."""
        ...

    def __len__(self) -> int:
        """T, frames so far; those that are there never change."""
        ...

    def window(self, first: int, last: int, /) -> Episode:
        """Frames first … last − 1."""
        ...


class Windows:
    """What is measured on stretches of the frames there are by now; forgotten when more come."""

    def __init__(self, recording: Recording, baseline_frames: int, backend: str) -> None:
        """``baseline_frames``, ``backend``: as ``signals.measure.Signals`` takes them."""
        self._recording, self._baseline, self._backend = recording, baseline_frames, backend
        self._known: dict[tuple[int, int], Relations] = {}

    def relations(self, first: int, last: int) -> Relations:
        """Relations of frames first … last − 1; their signals, too. Frames count from the first."""
        if (first, last) not in self._known:
            episode = self._recording.window(first, last)
            signals = Signals(episode, self._baseline, self._backend)
            signals.gaps.whole = False
            self._known[first, last] = Relations(signals)
        return self._known[first, last]
