"""The clock of an episode: how long its samples last, and how many of them make up a duration."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

EVEN = 0.05
"""A clock is uniform if no spacing differs from the median by more than this share of it."""

MAX_GAP = 3.0
"""A spacing of more than so many usual ones is a hole …"""
LEAST_GAP = 0.05
"""… unless it is no longer than this (s): a few samples lost at a high rate hide next to nothing."""
LONGEST_GAP = 0.5
"""S; a longer spacing is a hole at any rate: so rare pictures are no recording of a motion."""

ROUNDING = 1e-6
"""Share of a spacing that a duration may be short of and still counts as reached."""


class Window:
    """The samples that make up a duration, counted from each sample on, or back from each.

    A boundary k is where sample k begins, and sample k − 1 ends; boundary T is the end of the
    recording. Boundaries beyond it are T + 1: the recording ends before.

    Attributes:
        frames: their number, on a uniform clock; on any other the least that there must be.
        stops: (T,) boundary behind the shortest run from each sample on that lasts as long; None
            on a uniform clock.
        firsts: (T + 1,) the first sample of those that lie, at least in part, in the duration
            before each boundary; may be negative.
        since: (T,) the first sample of the shortest run up to each sample that lasts as long, as
            far as can be said at that sample; negative where there is none.
        loose: the window of the shortest run of samples that may have lasted as long; itself
            where that is not told apart.
    """

    def __init__(
        self,
        frames: int,
        stops: I64 | None = None,
        firsts: I64 | None = None,
        since: I64 | None = None,
        loose: Window | None = None,
    ) -> None:
        self.frames, self.stops, self.firsts, self.since = frames, stops, firsts, since
        self.loose = loose or self

    def stop(self, frame: int) -> int:
        """The boundary behind the duration that begins with a sample; beyond T if it is cut."""
        if self.stops is None:
            return frame + self.frames
        return int(self.stops[frame]) if frame < len(self.stops) else len(self.stops) + 1

    def first(self, boundary: int) -> int:
        """The first sample of the duration that ends at a boundary; may be negative."""
        return boundary - self.frames if self.firsts is None else int(self.firsts[boundary])

    def within(self, first: int, stop: int) -> Window:
        """The same, of the samples [first, stop) alone: what reaches beyond them is cut."""
        if self.stops is None:
            return self
        stops = self.stops[first:stop] - first
        stops = np.where(stops > stop - first, stop - first + 1, stops)
        loose = None if self.loose is self else self.loose.within(first, stop)
        return Window(self.frames, stops, loose=loose)


class Lasting(NamedTuple):
    """A duration as rules give it.

    Attributes:
        seconds: how long; None if it is counted in samples.
        samples: how many of them there must be at the least.
        brief: it stands for a few samples of a faster clock ("3 frames @ 120 Hz"): of a run of
            samples on a coarser one only bounds of its length are known.
    """

    seconds: float | None
    samples: int = 1
    brief: bool = False


class Clock:
    """Time stamps of an episode.

    A sample stands for the time up to the next one, the last for one usual spacing.

    Attributes:
        t: (T,) s, when each sample was taken.
        dt: s, the usual spacing: the mean of a uniform clock, else the median.
        uniform: all spacings are alike, and durations are counted in samples.
        unseen: (T,) frames that were put in where nothing was recorded; None if there are none.
    """

    def __init__(self, t: F64, dt: float, unseen: Bool | None = None) -> None:
        self.t, self.dt, self.unseen = t, dt if unseen is None else usual(dt), unseen
        self.uniform = unseen is None and is_uniform(t)
        self._known: dict[tuple[Lasting, bool], Window] = {}
        self._bounds: F64 | None = None

    @property
    def bounds(self) -> F64:
        """(T + 1,) s: when each sample begins, and when the last one ends."""
        if self._bounds is None:
            self._bounds = np.append(self.t, self.t[-1] + self.dt)
        return self._bounds

    @property
    def late(self) -> bool:
        """How the episode began was not recorded."""
        return self.unseen is not None and bool(self.unseen[0])

    def hole(self, frame: int) -> tuple[float, float] | None:
        """S, from when to when nothing was recorded around a frame that was put in."""
        if self.unseen is None or not self.unseen[frame]:
            return None
        seen = np.flatnonzero(~self.unseen)
        after = int(np.searchsorted(seen, frame))
        begin = self.t[seen[after - 1]] if after else 0.0
        return float(begin), float(self.t[seen[min(after, len(seen) - 1)]])

    def end_of(self, boundary: int) -> float:
        """S, when the sample before a boundary ends."""
        if self.uniform:
            return float(self.t[boundary - 1]) + self.dt
        return float(self.bounds[boundary])

    def seconds(self, first: int, stop: int) -> float:
        """How long the samples [first, stop) last."""
        if self.uniform:
            return (stop - first) * self.dt
        return float(self.bounds[stop] - self.bounds[first])

    @cached_property
    def longest(self) -> float:
        """S, the longest time that a sample stands for."""
        return self.dt if self.uniform else float(self.spacing.max())

    @property
    def spacing(self) -> F64:
        """(T,) s, how long each sample lasts."""
        return np.full(len(self.t), self.dt) if self.uniform else np.diff(self.bounds)

    def recorded(self, frame: int) -> int:
        """The frame itself, or for one that was put in the recorded one before it (or after)."""
        if self.unseen is None or not self.unseen[frame]:
            return frame
        seen = np.flatnonzero(~self.unseen)
        return int(seen[max(int(np.searchsorted(seen, frame)) - 1, 0)])

    def window(self, lasting: Lasting) -> Window:
        """The samples that a duration takes, from each on: at least so long, and so many."""
        return self._once(lasting, False)

    def gap(self, lasting: Lasting) -> Window:
        """Likewise the samples of the shortest gap that is too long to be closed."""
        return self._once(lasting, True)

    def _once(self, lasting: Lasting, gap: bool) -> Window:
        key = lasting, gap
        if key not in self._known:
            make = self._counted if self.uniform else self._stamped
            self._known[key] = make(lasting, gap)
        return self._known[key]

    def _counted(self, lasting: Lasting, gap: bool) -> Window:
        """On a uniform clock a duration D takes ⌈D / dt⌉ samples."""
        seconds, samples, brief = lasting
        if seconds is None:
            return Window(samples + gap)
        frames = max(samples, math.ceil(seconds / self.dt - ROUNDING)) + gap
        if not brief or gap:
            return Window(frames)
        # k samples lasted less than (k + 1) dt
        perhaps = max(1, math.floor(seconds / self.dt * (1 + EVEN) + ROUNDING))
        return Window(frames, loose=Window(perhaps) if perhaps < frames else None)

    def _stamped(self, lasting: Lasting, gap: bool) -> Window:
        seconds, samples, brief = lasting
        total, at, slack = len(self.t), np.arange(len(self.t)), ROUNDING * self.dt
        # of a frame that was put in nobody knows how many samples it stands for
        behind, before = np.full(total, total + 1), np.full(total, -1)
        if self.unseen is not None:
            where = np.where(self.unseen, at + 1, total + 1)
            behind = np.minimum.accumulate(where[::-1])[::-1]
            before = np.maximum.accumulate(np.where(self.unseen, at, -1))
        counted = at + samples + (gap and seconds is None)
        stops = np.where(counted > total, total + 1, counted)
        stops = np.minimum(stops, behind)
        firsts = np.arange(total + 1) - samples
        since = np.maximum(at - samples + 1 - (gap and seconds is None), before)
        if seconds is None:
            return Window(samples + gap, stops, firsts, since)
        t, bounds = self.t, self.bounds
        if gap:
            # the samples i … j may be closed if they are less than the duration apart
            ends = t if self.unseen is None else np.where(self.unseen, bounds[1:], t)
            long = np.searchsorted(ends, t + seconds - slack) + 1
            long = np.where(long > total, total + 1, np.maximum(long, at + 1))
            back = np.searchsorted(t, t - seconds + slack, side="right") - 1
            return Window(1, long, since=np.minimum(back, at))
        long = np.searchsorted(bounds, t + seconds - slack)
        stops = np.maximum(stops, long)
        firsts = np.minimum(
            firsts, np.searchsorted(bounds, bounds - seconds + slack, side="right") - 1
        )
        back = np.searchsorted(t, t + self.dt - seconds + slack, side="right") - 1
        loose = None
        if brief:
            # the run began after the sample before it, and ended before the one behind it
            begun = np.append(t[0] - self.dt, t[:-1])
            perhaps = np.searchsorted(bounds, begun + seconds + slack, side="right")
            perhaps = np.minimum(np.maximum(perhaps, at + 1), stops)
            loose = Window(1, perhaps, firsts, at)
        return Window(samples, stops, firsts, np.minimum(since, back), loose)


def usual(dt: float) -> float:
    """S, for how long a sample stands at most where the next one is missing."""
    return dt if dt <= LONGEST_GAP else LEAST_GAP


def is_uniform(t: F64) -> bool:
    """All spacings of (T,) stamps are within ``EVEN`` of their median."""
    if len(t) < 3:
        return True
    steps = t[1:] - t[:-1]
    least, most = float(steps.min()), float(steps.max())
    if most - least <= EVEN * least:
        return True
    median = float(np.median(steps))
    return median - least <= EVEN * median and most - median <= EVEN * median
