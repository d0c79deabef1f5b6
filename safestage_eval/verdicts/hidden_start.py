"""Changes since an event that came between two samples.

A body that was hit may have moved by the first sample that shows the touch. What the touch did is
measured from the sample before that. Of any other event between samples that are far apart nobody knows
where the body was when it came: the change is a range.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from safestage_eval.evidence.declare import is_gate
from safestage_eval.evidence.reference import Baseline, Reference
from safestage_eval.evidence.series import Series
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Bool

STEP = 0.05
"""Share of the limit that a body may go before a start there is looked at by itself …"""
MOST = 32
"""… and how many of them are."""


def concerns(event: ast.Event) -> bool:
    """The event comes between the frame at which it is seen and the one before."""
    return event.call is not None and is_gate(event.call.name) and event.edge != "end"


def before(baseline: Baseline, first: int, frames: int) -> Reference:
    """From frame ``first`` on the frame before it; up to there, and if it is 0, the baseline."""
    since = np.where(np.arange(frames) >= first, first - 1, -1)
    never = not 0 < first < frames  # the same then as since whatever else never came
    return Reference(baseline, since, "since " if never else f"since before {first}")


def one_earlier(reference: Reference, coarse: Bool) -> Reference | None:
    """The events, each as early as the sample before allows; None where that changes none.

    ``coarse`` (T,): much may happen up to the next sample.
    """
    since = reference.since
    if since is None or not coarse.any():
        return None
    between = (since > 0) & coarse[np.maximum(since - 1, 0)]
    if not between.any():
        return None
    return Reference(reference.baseline, since - between, f"earliest {reference.key}")


def either(one: Series, other: Series) -> Series:
    """A signal that is one of two: from the least that either may be to the most."""
    return Series(
        np.minimum(one.lower, other.lower),
        np.maximum(one.upper, other.upper),
        one.dimension,
        tuple(dict.fromkeys((*one.notes, *other.notes))),
    )


def since_some(
    measured: Callable[[Reference], Series],
    baseline: Baseline,
    possible: Bool,
    limit: float,
) -> Series:
    """A change since one of the ``possible`` (T,) frames, it is not known which: all it may be.

    A body's places at neighbouring starts differ by little: it is measured from some of them, and
    from those that follow it differs by no more than the body went meanwhile.

    Args:
        measured: the signal, as measured from a reference.
        baseline: of the body.
        possible: not all false.
        limit: SI, what the signal is compared with.
    """
    starts, frames = possible.nonzero()[0], len(possible)
    lower, upper, series = np.zeros(0), np.zeros(0), None
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
        if not turn:
            lower, upper = low, high
        lower[first:] = np.minimum(lower, low)[first:]
        upper[first:] = np.maximum(upper, high)[first:]
        starts = later[stop:]
        if not len(starts):
            break
    assert series is not None
    return Series(lower, upper, series.dimension, series.notes)
