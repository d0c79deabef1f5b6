"""Signals and relations of a recording that grows: what was measured is kept, new frames are added."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.evidence.contact_sums import ContactSums
from safestage_eval.evidence.declare import RELATIONS, SIGNALS, Options
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.partial import Partial
from safestage_eval.evidence.reference import Reference
from safestage_eval.evidence.series import Series
from safestage_eval.relations.measure import Relations

from .windows import Windows

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]


class Past:
    """Everything that was measured of the frames so far, by what was asked."""

    def __init__(self) -> None:
        """Nothing yet."""
        self._series: dict[Any, Series] = {}
        self._columns: dict[Any, NDArray[Any]] = {}
        self.partial: dict[tuple[str, tuple[str, ...], Options], Partial] = {}
        self.dependence: dict[tuple[str, ...], tuple[Bool, Bool, Bool]] = {}
        """Bodies → (T,) truth, where it is open, and the frames at which it was found out."""
        self.touched: set[Pair] = set()
        self.seen = 0
        """How many frames ``touched`` is of."""

    def series(self, key: Any, frames: int, measure: Callable[[int, int], Series]) -> Series:
        """Of so many frames; ``measure`` is asked for those from one to before another."""
        known = self._series.get(key)
        if known is None:
            known = measure(0, frames)
        elif len(known) < frames:
            more = measure(len(known), frames)
            lower = np.concatenate([known.lower, more.lower])
            same = known.upper is known.lower and more.upper is more.lower
            upper = lower if same else np.concatenate([known.upper, more.upper])
            notes = tuple(dict.fromkeys(known.notes + more.notes))
            known = Series(lower, upper, known.dimension, notes)
        self._series[key] = known
        return known

    def column(
        self, key: Any, frames: int, measure: Callable[[int, int], NDArray[Any]]
    ) -> NDArray[Any]:
        """(T,) likewise."""
        known = self._columns.get(key)
        if known is None:
            known = measure(0, frames)
        elif len(known) < frames:
            known = np.concatenate([known, measure(len(known), frames)])
        self._columns[key] = known
        return known


class GrownSums(ContactSums):
    """Sums of contact forces, to which those of new frames are added."""

    def __init__(self, episode: Episode, past: Past, windows: Windows) -> None:
        super().__init__(episode)
        self._past, self._windows = past, windows

    @cached_property
    def pairs(self) -> list[Pair]:
        """As in the base class."""
        past, frames = self._past, self._frames
        if past.seen < frames:
            past.touched.update(self._windows.signals(past.seen, frames).contact_sums.pairs)
            past.seen = frames
        return sorted(past.touched)

    def normal(self, i: int, j: int) -> F64:
        """As in the base class."""
        key = (min(i, j), max(i, j))
        return self._grown("normal", key, lambda sums: sums.normal(*key))

    def peak(self, i: int, j: int) -> F64:
        """As in the base class."""
        key = (min(i, j), max(i, j))
        return self._grown("peak", key, lambda sums: sums.peak(*key))

    def upward(self, on: int, by: int) -> F64:
        """As in the base class."""
        key = (max(on, by), min(on, by))
        found = self._grown("upward", key, lambda sums: sums.upward(*key))
        return found if on > by else -found

    def _grown(self, what: str, pair: Pair, of: Callable[[ContactSums], F64]) -> F64:
        def measure(first: int, last: int) -> F64:
            return of(self._windows.signals(first, last).contact_sums)

        return self._past.column((what, pair), self._frames, measure)


class GrownSignals(Signals):
    """Signals of all frames so far, measured at the new ones only where a frame tells its own value."""

    def __init__(
        self, episode: Episode, past: Past, windows: Windows, baseline_frames: int, backend: str
    ) -> None:
        super().__init__(episode, baseline_frames, backend)
        self.gaps.whole = False
        self.past, self.windows = past, windows

    @cached_property
    def contact_sums(self) -> ContactSums:
        """As in the base class."""
        return GrownSums(self.episode, self.past, self.windows)

    def _measure(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        cap: float,
        deep: bool,
        slack: float,
        options: Options,
    ) -> Series:
        if not SIGNALS[name].per_frame:
            found = super()._measure(name, bodies, reference, cap, deep, slack, options)
            return _open_end(found) if SIGNALS[name].ahead and found.notes else found

        def measure(first: int, last: int) -> Series:
            near = self.windows.signals(first, last)
            return near.measured(name, bodies, None, cap, deep, slack, options)

        return self.past.series(
            (name, bodies, cap, deep, slack, options), len(self.episode), measure
        )


class GrownRelations(Relations):
    """Relations of all frames so far, found out at the new ones only where a frame tells its own."""

    signals: GrownSignals

    def __init__(self, signals: GrownSignals) -> None:
        super().__init__(signals)
        self._past, self._windows = signals.past, signals.windows

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Bool | None:
        """As in the base class."""
        if self.blind or (not RELATIONS[name].per_frame and name != "depends_on"):
            return super().get(name, bodies, wanted)
        if self.lacking(name, bodies):
            return None
        if name == "depends_on":
            return self._depends_on((bodies[0], bodies[1]), wanted)[0]
        frames = len(self.episode)

        def measure(first: int, last: int) -> Bool:
            found = self._windows.relations(first, last).get(name, bodies)
            assert found is not None  # what a trace lacks, it lacks at every frame
            return found

        if name == "inside" and not self.signals.movers.of([bodies[0]]):
            return None
        return self._past.column((name, tuple(bodies)), frames, measure)

    def caught(self, body: str, on: str, wanted: Bool | None) -> Bool:
        """As in the base class."""
        return self._depends_on((body, on), wanted)[1]

    def _depends_on(self, bodies: tuple[str, str], wanted: Bool | None) -> tuple[Bool, Bool]:
        frames = len(self.episode)
        before = self._past.dependence.get(bodies, ())
        truth, open_, done = (np.zeros(frames, np.bool_) for _ in range(3))
        for now, then in zip((truth, open_, done), before, strict=False):
            now[: len(then)] = then
        todo = ~done if wanted is None else wanted & ~done
        if todo.any():
            first = int(todo.argmax())
            near = self._windows.relations(first, frames)
            found = near.get("depends_on", bodies, todo[first:])
            assert found is not None
            truth[first:][todo[first:]] = found[todo[first:]]
            open_[first:][todo[first:]] = near.caught(*bodies, todo[first:])[todo[first:]]
            done |= todo
        self._past.dependence[bodies] = truth, open_, done
        return truth, open_

    def signal(
        self,
        name: str,
        bodies: Sequence[str],
        reference: Reference | None = None,
        reach: float = 0,
        wanted: Bool | None = None,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Series:
        """As in the base class."""
        if not SIGNALS[name].costly:
            return super().signal(name, bodies, reference, reach, wanted, options, limits)
        key = (name, tuple(bodies), options)
        if key not in self._partial and key in self._past.partial:
            self._partial[key] = _longer(self._past.partial[key], len(self.episode))
        found = super().signal(name, bodies, reference, reach, wanted, options, limits)
        self._past.partial[key] = self._partial[key]
        return found

    def measure(
        self, name: str, at: NDArray[np.int64], bodies: Sequence[str], options: Options = ()
    ) -> Series:
        """As in the base class."""
        if self.blind:
            return super().measure(name, at, bodies, options)
        first = int(at.min())
        near = self._windows.relations(first, len(self.episode))
        return near.measure(name, at - first, bodies, options)


def _open_end(found: Series) -> Series:
    """The same, of which the last frame is not known yet."""
    lower, upper = found.lower.copy(), found.upper.copy()
    lower[-1:], upper[-1:] = -np.inf, np.inf
    return Series(lower, upper, found.dimension, found.notes)


def _longer(partial: Partial, frames: int) -> Partial:
    """The same of more frames, with nothing known of those that are new."""
    found, before = Partial.blank(frames), len(partial.done)
    found.lower[:before], found.upper[:before] = partial.lower, partial.upper
    found.done[:before] = partial.done
    for note, about in partial.notes.items():
        found.notes[note] = np.zeros(frames, np.bool_)
        found.notes[note][:before] = about
    return found
