"""Run the checks of header and columns on one episode."""

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


def header_contradictions(episode: Episode) -> Iterator[ContradictionError]:
    """What header and time stamps say that cannot all be true; nothing else is read."""
    yield from _found(episode, "header")


def contradictions(episode: Episode, at_hand: AtHand | None = None) -> Iterator[ContradictionError]:
    """Everything that cannot be true, of a sound file.

    ``at_hand``: columns that may be read; None: all, and the header as well.
    """
    if at_hand is None:
        yield from header_contradictions(episode)
    columns, sound = Columns(episode, at_hand), True
    for error in _found(columns, "columns"):
        sound &= error.code not in body_doubts.CODES
        yield error
    if sound:
        columns.remember_sound()


def _found(subject: Episode | Columns, over: str) -> Iterator[ContradictionError]:
    episode = subject.episode if isinstance(subject, Columns) else subject
    where = str(episode.path or episode.header.episode_id)
    for check in CHECKS.values():
        for error in check.run(subject) if check.over == over else ():
            yield replace(error, where=where, code=check.code)
