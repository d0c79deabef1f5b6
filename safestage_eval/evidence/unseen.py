"""What frames at which nothing was recorded leave unknown of a signal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .facts import Query
from .options import DEFAULT_OVER
from .series import Series, hide

Bool = NDArray[np.bool_]

DIFFERENCES = ("speed", "vertical_speed", "angular_speed", "relative_speed", "joint_speed")
"""Signals that come from neighbouring poses where velocities were not recorded (a note says so)."""

OVER = ("impact", "quasistatic_force", "damage")
"""Signals of a change of velocity over a stated time before each frame."""

GROWING = ("impulse",)
FALLING = ("health",)
"""Signals that add up what was: more, or less, after a hole than was seen."""


def mask_unseen(found: Series, query: Query) -> Series:
    """The series, unknown where ``Episode.unseen`` is, and where it looks back to such a frame."""
    unseen = query.episode.unseen
    if unseen is None:
        return found
    hidden = unseen | _looks_back(query, unseen)
    if query.name in DIFFERENCES and found.notes:
        hidden[:-1] |= unseen[1:]
        hidden[1:] |= unseen[:-1]
    if query.name in OVER or looks_over(query):
        hidden |= _within(query, unseen)
    found = hide(found, hidden)
    lower, upper = found.lower, found.upper
    after = np.logical_or.accumulate(unseen)
    if query.name in GROWING:
        upper = np.where(after, np.inf, upper)
    if query.name in FALLING:
        lower = np.where(after, -np.inf, lower)
    return replace(found, lower=lower, upper=upper)


def looks_over(query: Query) -> bool:
    """How far it went or turned within a stated time, from the poses."""
    return query.name in ("speed", "angular_speed") and query.option("over") is not None


def _looks_back(query: Query, unseen: Bool) -> Bool:
    """(T,) where a change is measured from a moment that was not seen; the baseline may be one."""
    from .vocabulary import SIGNALS

    nothing = np.zeros(len(unseen), np.bool_)
    since = None if query.since is None else query.since.since
    if not SIGNALS[query.name].since or (since is None and query.name == "height"):
        return nothing
    if since is None:
        return np.full(len(unseen), unseen[0])
    return np.asarray(np.where(since < 0, unseen[0], unseen[since]), np.bool_)


def _within(query: Query, unseen: Bool) -> Bool:
    """(T,) less than the stated time after a hole."""
    over, t = float(query.option("over") or DEFAULT_OVER), query.episode.t  # type: ignore[arg-type]
    bounds = query.episode.clock.bounds
    ends = np.maximum.accumulate(np.where(unseen, bounds[1:], -np.inf))
    return np.asarray(t < ends + over)
