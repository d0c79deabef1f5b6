"""The past operators of temporal logic, on time stamps.

``once``, ``always`` (also called historically) and ``since`` look from each sample back at those that
stand, at least in part, for some time from b to a seconds before it. Sample j stands for the time from
t_j up to t_{j+1}, so those are the samples with t_j <= t − a and t_{j+1} > t − b: on an even clock the
samples k − ⌈b/dt⌉ … k − ⌈a/dt⌉, which is what discrete-time STL means (Maler & Nickovic, "Monitoring
temporal properties of continuous signals", 2004). Before the first sample there is nothing: what was
``once`` was not there, and what ``always`` was is not broken there.

All of them only select margins, by minimum and maximum.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.clock import ROUNDING, Clock, Lasting

from .band import F64, Band, each, negated

I64 = NDArray[np.int64]


class Looks(NamedTuple):
    """(T,) the samples [firsts, stops) that each sample looks back at; none where they are equal."""

    firsts: I64
    stops: I64


def looks(clock: Clock, recent: Lasting, far: Lasting | None) -> Looks:
    """The samples from ``far`` to ``recent`` ago, seen from each; from the start if ``far`` is None."""
    total = len(clock.t)
    at = np.arange(total)
    stops = _reached(clock, recent) + 1
    if far is None:
        firsts = np.zeros(total, np.int64)
    elif far.seconds is None:
        firsts = at - far.samples
    elif clock.uniform:
        firsts = at - math.ceil(far.seconds / clock.dt - ROUNDING)
    else:
        slack = ROUNDING * clock.dt
        firsts = np.searchsorted(clock.bounds[1:], clock.t - far.seconds + slack, side="right")
    firsts = np.clip(firsts, 0, total)
    return Looks(firsts, np.maximum(np.clip(stops, 0, total), firsts))


def _reached(clock: Clock, recent: Lasting) -> I64:
    """(T,) the last sample that has begun so long before each; negative where none has."""
    at = np.arange(len(clock.t))
    if recent.seconds is None:
        return at - recent.samples
    if clock.uniform:
        return at - math.ceil(recent.seconds / clock.dt - ROUNDING)
    slack = ROUNDING * clock.dt
    return np.searchsorted(clock.t, clock.t - recent.seconds + slack, side="right") - 1


def once(held: Band, at: Looks) -> Band:
    """(T,) it held at one of the samples."""
    return each(lambda margin: greatest(margin, at), held)


def always(held: Band, at: Looks) -> Band:
    """(T,) it held at all of the samples."""
    return each(lambda margin: -greatest(-margin, at), held)


def since(held: Band, begun: Band, at: Looks) -> Band:
    """(T,) at one of the samples something had ``begun``, and at every later one until now it held."""
    return each(lambda margin, start: _since(margin, start, at), held, begun)


def alike(first: Band, second: Band) -> Band:
    """(T,) both hold, or neither does.

    Its margin is the smaller one of the two, positive where they agree. It grows or falls with each
    of them, so that its ends are among those at the ends of both.
    """
    if first.exact and second.exact:
        found = _alike(first.lower, second.lower)
        return Band(found, found)
    corners = np.array([_alike(a, b) for a in first for b in second])
    return Band(corners.min(axis=0), corners.max(axis=0))


def _alike(a: F64, b: F64) -> F64:
    return np.maximum(np.minimum(a, b), np.minimum(negated(a), negated(b)))


def greatest(margin: F64, at: Looks) -> F64:
    """(T,) the greatest margin of the samples that each looks at; −∞ where there are none."""
    (found,) = _joined((margin,), lambda a, b: (np.maximum(a[0], b[0]),), at, (-np.inf,))
    return found


def _since(held: F64, begun: F64, at: Looks) -> F64:
    """(T,) of one end: the best of the samples, each as good as what came after it allows."""
    best, _ = _joined((begun, held), _later, at, (-np.inf, np.inf))
    now = np.arange(len(held)) + 1
    return np.minimum(best, -greatest(-held, Looks(at.stops, np.maximum(now, at.stops))))


Parts = tuple[F64, ...]


def _later(earlier: Parts, later: Parts) -> Parts:
    """Best start and least margin of two stretches, the one behind the other; they may overlap."""
    start, least = earlier
    return np.maximum(later[0], np.minimum(start, later[1])), np.minimum(least, later[1])


def _joined(
    parts: Parts, join: Callable[[Parts, Parts], Parts], at: Looks, none: tuple[float, ...]
) -> Parts:
    """(T,) of each part over each window, from windows of 1, 2, 4, … samples; two that overlap make one.

    ``none``: over no samples.
    """
    lengths = at.stops - at.firsts
    out = tuple(np.full(len(lengths), empty) for empty in none)
    size, table = 1, parts
    while (lengths >= size).any():
        here = (lengths >= size) & (lengths < 2 * size)
        first, last = at.firsts[here], at.stops[here] - size
        found = join(tuple(p[first] for p in table), tuple(p[last] for p in table))
        for end, values in zip(out, found, strict=True):
            end[here] = values
        if not (lengths >= 2 * size).any():
            break
        table = join(tuple(p[:-size] for p in table), tuple(p[size:] for p in table))
        size *= 2
    return out
