"""The evaluator's own view of an episode: with a frame in every stretch that was not recorded.

A spacing of time stamps that is too long is a *hole*. The view has one more frame there, one usual
spacing after the last sample, at which nothing is known (``Episode.unseen``): poses are held so that
arrays stay whole, and there are no contacts. Likewise at time 0, where the recording begins late.
Files are never changed, and ``Episode.recorded`` is the episode as it was given.

That a body stands as before when the hole is over proves nothing: it may have been away and back,
and how fast it was seen to move says nothing about how fast it moved unseen. So nothing that happens
in a hole is ever taken as known.
"""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .clock import longest_spacing, usual
from .contacts import ContactTable
from .episode import Episode
from .frames import RobotFrames
from .lazy_columns import StoredItems
from .track import Track

LATE = 1.5
"""The first sample may come so many spacings after time 0: one, and half of one for jitter."""


def with_holes(episode: Episode, *, begins: bool = True) -> Episode:
    """Return the episode with a frame in every hole; unchanged where there is none, or they are in.

    ``begins``: it is recorded from its start, not a window of it.
    """
    t, dt = episode.t, episode.dt
    if episode.recorded is not None or not len(t):
        return episode
    spacing = t[1:] - t[:-1]
    late = bool(begins and t[0] > LATE * usual(dt))
    longest = longest_spacing(dt)
    if not late and not (len(spacing) and spacing.max() > longest):
        return episode
    before = np.flatnonzero(spacing > longest)
    return _filled(episode, before, late)


def _filled(episode: Episode, before: NDArray[np.intp], late: bool) -> Episode:
    """With a frame behind each of the given ones, and one at time 0 if it begins late.

    A success that came in a hole has a frame of its own: what lies after it is counted from there.
    """
    t, reached = episode.t, episode.header.success_time
    put_in = t[before] + usual(episode.dt)
    if reached is not None:
        inside = np.flatnonzero((put_in + 1e-6 < reached) & (reached < t[before + 1] - 1e-6))
        put_in, before = (
            np.append(put_in, [reached] * len(inside)),
            np.append(before, before[inside]),
        )
    times = np.concatenate([[0.0] if late else [], t, put_in])
    source = np.concatenate([[0] if late else [], np.arange(len(t)), before]).astype(np.int64)
    added = np.ones(len(times), np.bool_)
    added[late : late + len(t)] = False
    order = np.argsort(times, kind="stable")
    times, source, added = times[order], source[order], added[order]
    unseen = added if episode.unseen is None else added | episode.unseen[source]
    place = np.flatnonzero(~added)

    def track(name: str) -> Track:
        found = episode.tracks[name]
        if len(found) == 1 and len(t) > 1:
            return found
        return Track(*(getattr(found, column.name)[source] for column in fields(Track)))

    def contacts() -> ContactTable:
        table = episode.contacts
        columns = {column.name: getattr(table, column.name) for column in fields(ContactTable)}
        columns["frame"] = place[columns["frame"]].astype(np.int32)
        return ContactTable(**columns)

    def frames() -> RobotFrames:
        found = episode.frames
        return RobotFrames(*(getattr(found, column.name)[source] for column in fields(RobotFrames)))

    return replace(
        episode,
        t=times,
        tracks=StoredItems(episode.tracks, track),
        _contacts=contacts,
        _frames=frames,
        channels=StoredItems(episode.channels, lambda key: episode.channels[key][source]),
        states=StoredItems({int(place[frame]): frame for frame in episode.states},
                      lambda frame: episode.states[int(source[frame])]),
        unseen=unseen,
        recorded=episode,
    )  # fmt: skip


def describe_holes(episode: Episode) -> list[str]:
    """In words, for the reader of a verdict: when nothing was recorded."""
    if episode.unseen is None:
        return []
    t, seen = episode.t, np.flatnonzero(~episode.unseen)
    if not len(seen):
        return ["nothing was recorded at any time"]
    told, notes = [], list[str]()
    if episode.unseen[0]:
        notes.append(f"the recording begins at {t[seen[0]]:.2f} s: how it began was not seen")
    for last, following in pairwise(seen.tolist()):
        if following > last + 1:
            told.append(f"{t[last]:.2f} to {t[following]:.2f} s")
    if told:
        more = f" and {len(told) - 3} more times" if len(told) > 3 else ""
        notes.append(
            f"nothing was recorded from {', from '.join(told[:3])}{more}: "
            "what happened then is not known"
        )
    return notes
