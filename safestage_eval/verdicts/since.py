"""Changes since an event: what a signal is measured from.

A body that was hit may have moved by the first sample that shows the touch. What the touch did is
measured from the sample before that. Of any other event between samples that are far apart nobody knows
where the body was when it came: the change is a range.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from safestage_eval.evidence.interval_arithmetic import change_since
from safestage_eval.evidence.intervals import Bool, Interval, hide
from safestage_eval.evidence.reference import Baseline, Reference, latest
from safestage_eval.rules import syntax as ast

from . import computed_signals
from .between_samples import earliest, falls_between
from .events import frames_of
from .language import Asked, Env, Language

STEP = 0.05
"""Share of the limit that a body may go before a start there is looked at by itself …"""
MOST = 32
"""… and how many of them are."""


def measured(
    evaluator: Language, asked: Asked, atom: ast.SignalAtom, env: Env, frames: Bool | None
) -> Interval:
    """(T,) a signal; the costly ones are measured at ``frames`` (T,) alone, everywhere if None."""
    name, bodies, options, limits, reach = asked
    computed, event = evaluator.rules.derived.get(name), atom.since

    def from_(reference: Reference | None) -> Interval:
        if computed is None:
            return evaluator.relations.signal(
                name, bodies, reference, reach, frames, options, tuple(map(float, limits))
            )
        where = frames if reference is None else None
        series = computed_signals.series_of(evaluator, computed, bodies, where)
        if reference is None or reference.since is None:
            return series
        return Interval(*change_since(series, reference.since), series.dimension, series.notes)

    if event is None:
        return from_(None)
    reference, when = reference_of(evaluator, event, env)
    if when is not None and falls_between(event) and evaluator.signal(name).metric:
        return since_some(from_, evaluator.relations.signals.baseline, when.possible, reach)
    series = from_(reference)
    earlier = earliest(evaluator, event, reference)
    if earlier is not None:
        series = either(series, from_(earlier))
    if when is None:
        return series
    newest = np.maximum.accumulate(np.where(when.possible, np.arange(evaluator.frames), -1))
    return hide(series, (newest >= 0) & ~when.true[newest])


def either(one: Interval, other: Interval) -> Interval:
    """A signal that is one of two: from the least that either may be to the most."""
    lower, upper = np.minimum(one.lower, other.lower), np.maximum(one.upper, other.upper)
    notes = tuple(dict.fromkeys((*one.notes, *other.notes)))
    return Interval(lower, upper, one.dimension, notes)


def reference_of(
    evaluator: Language, event: ast.Event, env: Env
) -> tuple[Reference, Interval | None]:
    """The reference of a change since an event; and the event's frames, if any is uncertain."""

    def find() -> tuple[Reference, Interval | None]:
        when = frames_of(evaluator.moments(event, env), evaluator.frames)
        baseline = evaluator.relations.signals.baseline
        instants = when.possible.nonzero()[0]
        if falls_between(event):
            first = int(instants[0]) if len(instants) else evaluator.frames
            reference = before(baseline, first, evaluator.frames)
        else:
            since, key = latest(instants, evaluator.frames), f"since {instants.tobytes().hex()}"
            reference = Reference(baseline, since, key)
        return reference, None if when.decided else when

    return evaluator.once(event, ("since", *env.items()), find)


def before(baseline: Baseline, first: int, frames: int) -> Reference:
    """From frame ``first`` on the frame before it; up to there, and if it is 0, the baseline."""
    since = np.where(np.arange(frames) >= first, first - 1, -1)
    never = not 0 < first < frames  # the same then as since whatever else never came
    return Reference(baseline, since, "since " if never else f"since before {first}")


def since_some(
    measured: Callable[[Reference], Interval], baseline: Baseline, possible: Bool, limit: float
) -> Interval:
    """A change since one of the ``possible`` (T,) frames, it is not known which: all it may be.

    A body's places at neighbouring starts differ by little: it is measured from some of them, and
    from those that follow it differs by no more than the body went meanwhile.

    ``limit``: SI, what the signal is compared with.
    """
    starts, frames = possible.nonzero()[0], len(possible)
    found: Interval | None = None
    for turn in range(MOST):
        first, later = int(starts[0]), starts[1:]
        series = measured(before(baseline, first, frames))
        apart = series.upper[later - 1]
        far = apart > STEP * limit
        stop = len(later) if turn == MOST - 1 or not far.any() else int(far.argmax())
        slack = np.zeros(frames)
        slack[later[:stop]] = apart[:stop]
        slack = np.maximum.accumulate(slack)
        low, high = np.maximum(series.lower - slack, 0.0), series.upper + slack
        if found is None:
            found = replace(series, lower=low, upper=high)
        found.lower[first:] = np.minimum(found.lower, low)[first:]
        found.upper[first:] = np.maximum(found.upper, high)[first:]
        starts = later[stop:]
        if not len(starts):
            break
    assert found is not None
    return found
