"""Run the checks of columns on one episode."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from safestage_eval.episode import Episode
from safestage_eval.episode.contradiction import ContradictionError

from . import (  # noqa: F401 — they declare the checks
    body_doubts,
    contact_doubts,
    header_doubts,
    joint_doubts,
    motion_doubts,
    weight_doubts,
)
from .check_registry import CHECKS
from .columns import AtHand, Columns


def contradictions(episode: Episode, at_hand: AtHand | None = None) -> Iterator[ContradictionError]:
    """Everything that cannot be true, of a sound file; ``at_hand``: what may be read, None: all."""
    columns = Columns(episode, at_hand)
    where, sound = str(episode.path or episode.header.episode_id), True
    for check in CHECKS.values():
        for error in check.run(columns) if check.over == "columns" else ():
            sound &= check.run.__module__ != body_doubts.__name__
            yield replace(error, where=where, code=check.code)
    if sound:
        columns.remember_sound()
