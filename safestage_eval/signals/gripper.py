"""Signals of the gripper as a whole."""

from __future__ import annotations

from .facts import Query
from .series import Series, exact


def opening(query: Query) -> Series:
    """0 closed … 1 open, as recorded."""
    recorded = query.episode.frames.gripper
    if not recorded.shape[1]:
        return query.unknown("the trace has no gripper opening")
    return exact(recorded[:, 0], query.dimension)
