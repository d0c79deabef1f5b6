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

SURELY = 2
"""Samples: of one that is far from its neighbours nobody knows how long what it shows lasted."""

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
        backs: (T,) the first sample of the shortest run up to each that lasts as long; negative where
            there is none.
        firsts: (T + 1,) the first sample of those that lie, at least in part, in the duration
            before each boundary; may be negative.
        since: (T,) as ``backs``, as far as can be said when the sample is taken.
        loose: the window of the shortest run of samples that may have lasted as long; itself
            where that is not told apart: at rates at which a sample more or less does not matter.
    """

    def __init__(
        self,
        frames: int,
        stops: I64 | None = None,
        backs: I64 | None = None,
        firsts: I64 | None = None,
        since: I64 | None = None,
        loose: Window | None = None,
    ) -> None:
        self.frames, self.stops, self.backs = frames, stops, backs
        self.firsts, self.since = firsts, since
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
        if self.stops is None or self.backs is None:
            return self
        stops = self.stops[first:stop] - first
        stops = np.where(stops > stop - first, stop - first + 1, stops)
        loose = None if self.loose is self else self.loose.within(first, stop)
        return Window(self.frames, stops, self.backs[first:stop] - first, loose=loose)


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
        if not len(seen):
            return 0.0, float(self.t[-1])
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

    @cached_property
    def coarse(self) -> Bool:
        """(T,) the next sample comes so much later that what lies between them matters."""
        return self.spacing > LEAST_GAP * (1 + EVEN)

    def together(self, first: int, frames: int) -> int:
        """How many of so many samples from one on no hole parts from it; those to come count."""
        if self.unseen is None:
            return frames
        seen = np.flatnonzero(~self.unseen[first : first + frames + 1])
        far = np.flatnonzero(np.diff(self.t[first + seen]) > longest_spacing(self.dt))
        return int(seen[far[0]]) + 1 if len(far) else frames

    def soon(self, frames: int) -> int:
        """How many of the first so many samples come as soon as they do at 20 Hz; those to come count."""
        late = self.t[:frames] - self.t[0] > (frames - 1) * LEAST_GAP * (1 + EVEN)
        return int(late.argmax()) if late.any() else frames

    def recorded(self, frame: int) -> int:
        """The frame itself, or for one that was put in the recorded one before it (or after)."""
        if self.unseen is None or not self.unseen[frame] or self.unseen.all():
            return frame
        seen = np.flatnonzero(~self.unseen)
        return int(seen[max(int(np.searchsorted(seen, frame)) - 1, 0)])

    def window(self, lasting: Lasting) -> Window:
        """The samples that a duration takes, from each on: at least so long, and so many."""
        return self._once(lasting, False)

    def surely(self, lasting: Lasting) -> Window:
        """The samples that show that something lasted so long, where they are far apart.

        From the first to the last of them; of a few samples of a faster clock two will do.
        """
        seconds, samples, brief = lasting
        if seconds is not None and not brief:
            seconds += self.dt
        return self.window(Lasting(seconds, max(samples, SURELY), brief))

    def gap(self, lasting: Lasting) -> Window:
        """The samples of the shortest gap that is too long to be closed, from each sample on."""
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
        if gap or not self._doubtful(brief):
            return Window(frames)
        # k samples lasted less than (k + 1) dt
        perhaps = max(1, math.floor(seconds / self.dt * (1 + EVEN) + ROUNDING))
        return Window(frames, loose=Window(perhaps) if perhaps < frames else None)

    def _doubtful(self, brief: bool) -> bool:
        """Only bounds are known of how long a run of samples lasted, and they matter."""
        return brief or bool(self.coarse.any())

    def _stamped(self, lasting: Lasting, gap: bool) -> Window:
        """On any other clock it takes those that its time stamps say."""
        seconds, samples, brief = lasting
        total, at, slack = len(self.t), np.arange(len(self.t)), ROUNDING * self.dt
        t, bounds = self.t, self.bounds
        frames = samples + gap
        # of a frame that was put in nobody knows how many samples it stands for
        behind, before = np.full(total, total + 1), np.full(total, -1)
        if self.unseen is not None:
            where = np.where(self.unseen, at + 1, total + 1)
            behind = np.minimum.accumulate(where[::-1])[::-1]
            before = np.maximum.accumulate(np.where(self.unseen, at, -1))
        stops = np.minimum(np.where(at + frames > total, total + 1, at + frames), behind)
        backs = np.maximum(at - frames + 1, before)
        firsts = np.arange(total + 1) - samples
        if seconds is None:
            return Window(frames, stops, backs, firsts, backs)
        if gap:
            # the samples i … j may be closed if they are less than the duration apart
            ends = t if self.unseen is None else np.where(self.unseen, bounds[1:], t)
            long = np.searchsorted(ends, t + seconds - slack) + 1
            long = np.where(long > total, total + 1, np.maximum(long, at + 1))
            back = np.minimum(np.searchsorted(t, ends - seconds + slack, side="right") - 1, at)
            since = np.minimum(np.searchsorted(t, t - seconds + slack, side="right") - 1, at)
            return Window(
                1, np.maximum(stops, long), np.minimum(backs, back), since=np.minimum(backs, since)
            )
        begun = np.searchsorted(bounds, bounds - seconds + slack, side="right") - 1
        stops = np.maximum(stops, np.searchsorted(bounds, t + seconds - slack))
        since = np.searchsorted(t, t + self.dt - seconds + slack, side="right") - 1
        since, backs = np.minimum(backs, since), np.minimum(backs, begun[1:])
        loose = None
        if self._doubtful(brief):
            # the run began after the sample before it, and ended before the one behind it
            last = np.append(t[0] - self.dt, t[:-1])
            perhaps = np.searchsorted(bounds, last + seconds + slack, side="right")
            perhaps = np.minimum(np.maximum(perhaps, at + 1), stops)
            back = np.minimum(np.searchsorted(last, bounds[1:] - seconds - slack) - 1, at)
            loose = Window(1, perhaps, np.maximum(back, backs), since=at)
        return Window(samples, stops, backs, np.minimum(firsts, begun), since, loose)


def usual(dt: float) -> float:
    """S, for how long a sample stands at most where the next one is missing."""
    return dt if dt <= LONGEST_GAP else LEAST_GAP


def longest_spacing(dt: float) -> float:
    """S, the longest spacing of samples that is no hole, where ``dt`` (s) is the usual one."""
    return min(max(MAX_GAP * dt, LEAST_GAP), LONGEST_GAP) * (1 + 1e-6)


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
