"""Signals of poses at a few neighbouring frames: what they are there when all frames are measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.lengths import distances, lengths
from safestage_eval.geometry.pose import angle, rotate

from .motion import com_position
from .reference import Reference

if TYPE_CHECKING:
    from .facts import Facts

F64 = NDArray[np.float64]

SIGNALS = ("displacement", "displacement_xy", "turn", "tilt")
"""Those that need no other frames, but for what they look back to."""


def at_frames(
    facts: Facts, name: str, body: str, reference: Reference | None, frames: slice
) -> F64 | None:
    """(N,) one of ``SIGNALS`` at N neighbouring frames.

    None where some of them look back to another moment than others, or the body has no up axis.
    """
    episode = facts.episode
    if name == "tilt":
        axis = episode.bodies[body].up_axis
        if axis is None:
            return None
        up = rotate(episode.track(body).orientation[frames], np.asarray(axis, np.float64))
        return np.asarray(np.arctan2(lengths(up, 2), up[:, 2]))
    if facts.baseline_of(body).notes:
        return None  # it settles first
    since = -1 if reference is None else reference.among(frames)
    if since is None:
        return None
    if name == "turn":
        orientation = episode.track(body).orientation
        one = orientation[since].astype(np.float64)
        if since < 0:
            one = facts.baseline.orientation(orientation)
        return angle(orientation[frames], one)
    now = com_position(episode, body, frames)
    if since < 0:
        there = facts.baseline.position(com_position(episode, body, facts.baseline.stretch))
    else:
        there = com_position(episode, body, slice(since, since + 1))[0]
    return distances(now, there[None], 2 if name.endswith("xy") else 3)
