"""Durations as the parameter that is moved: which runs last, and which gaps are closed, up to where."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from safestage_eval.episode import Clock
from safestage_eval.episode.runs import runs
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import F64
from safestage_eval.verdicts.values import lasting

from .flip_keys import LARGEST, Way, key_of


class Undecided(Exception):  # noqa: N818 - it is no error
    """Raised where the dependence of a verdict on a parameter cannot be followed; it has to be judged again."""


class Counts:
    """How many samples of a uniform clock a duration takes, as it grows."""

    def __init__(self, clock: Clock, value: ast.Setting) -> None:
        """``value``: of the kind that is moved."""
        self._clock = clock
        self._kind = value if isinstance(value, ast.Duration) else ast.Duration(0.0)
        self._first: dict[tuple[int, bool], float] = {}

    def frames(self, number: float, *, gap: bool = False) -> int:
        """Samples that a duration of this size takes; for a ``gap``, of the longest that is closed."""
        if not self._clock.uniform:
            raise Undecided("the clock is not uniform")
        duration = ast.Duration(number, self._kind.frames)
        if gap:
            return self._clock.gap(lasting(duration, 0)).frames - 1
        return self._clock.window(lasting(duration)).frames

    def first(self, frames: int, *, gap: bool = False) -> float:
        """The least duration that takes at least ``count`` samples; 0 if all do."""
        least = self._first.get((frames, gap))
        if least is None:
            step = 1.0 if self._kind.frames else self._clock.dt
            near = max((frames - 2) * step, 0.0), (frames + 1) * step
            least = first_true(lambda number: self.frames(number, gap=gap) >= frames, *near)
            self._first[frames, gap] = least
        return least

    def size(self, frames: int, way: Way) -> float:
        """Size of the key up to which a duration takes at most ``count`` samples; down, at least."""
        if way == "up":
            return self.first(frames + 1)
        return until(self.first(frames))


def steps_from(frames: int, total: int, way: Way) -> list[int]:
    """Some numbers of samples from one on, up to all of them or down to none; the nearest first."""
    out, step = list[int](), 0
    while 0 <= (n := frames + step if way == "up" else frames - step) <= max(total, frames):
        out.append(n)
        step += max(1, step // 4)
    return [n for n in out if n > 0] or [frames]


def first_true(holds: Callable[[float], bool], low: float = 0.0, high: float = 1.0) -> float:
    """The least float from 0 on at which something holds that then holds for good; ``inf`` if none.

    ``low``, ``high``: between which it probably is.
    """
    if holds(low):
        if holds(0.0):
            return 0.0
        low, high = 0.0, low
    while not holds(high):
        low, high = high, high * 2
        if high > 1e9:
            return float("inf")
    while np.nextafter(low, np.inf) < high:
        middle = (low + high) / 2
        if holds(middle):
            high = middle
        else:
            low = middle
    return high


def lasting_keys(keys: F64, counts: Counts, value: float, way: Way, *, open_end: bool) -> F64:
    """Keys (T,) of being in a run of truth that lasts for the parameter.

    Args:
        keys: (T,) of truths that do not depend on it.
        counts: samples of a duration.
        value: of the parameter.
        way: in which it moves.
        open_end: a run at the end of the recording may have gone on.
    """
    out, needed = np.full(len(keys), -np.inf), counts.frames(value)
    for first, stop in runs(keys >= 0).tolist():
        length = stop - first
        if open_end and stop == len(keys):
            out[first:stop] = np.inf
        elif length >= needed:
            out[first:stop] = counts.first(length + 1) if way == "up" else np.inf
        elif way == "down":
            out[first:stop] = -until(counts.first(length + 1))
    return out


def closed_keys(keys: F64, counts: Counts, value: float, way: Way) -> F64:
    """Keys (T,) of being true, or in a gap between two true frames that the parameter closes."""
    out, closed = keys.copy(), counts.frames(value, gap=True)
    for first, stop in runs(keys < 0).tolist():
        if first == 0 or stop == len(keys):
            continue
        length = stop - first
        if length <= closed:
            at = counts.first(length, gap=True)
            never = way == "up" or at == 0
            out[first:stop] = np.inf if never else until(at)
        elif way == "up":
            out[first:stop] = -counts.first(length, gap=True)
    return out


def until(first: float) -> float:
    """Size of a key: moving down, of what changes at the last value before ``first``."""
    return np.inf if first == 0 else key_of(min(float(np.nextafter(first, 0.0)), LARGEST), "down")
