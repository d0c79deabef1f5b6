"""An episode recorded at other moments: some of its frames, as if no others had been taken."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, RobotFrames, Track


def resampled(episode: Episode, frames: NDArray[np.integer], **header: object) -> Episode:
    """The episode of which only some frames (indices, ascending) were recorded.

    Forces and peaks are those of the frames themselves: what happened in between left no trace.
    """
    t = episode.t[frames]
    place = np.full(len(episode), -1)
    place[frames] = np.arange(len(frames))
    contacts = episode.contacts.where(place[episode.contacts.frame] >= 0)
    contacts = replace(contacts, frame=place[contacts.frame].astype(np.int32))
    tracks = {
        name: track
        if len(track) == 1
        else Track(*(getattr(track, column.name)[frames] for column in fields(Track)))
        for name, track in episode.tracks.items()
    }
    robot = RobotFrames(*(getattr(episode.frames, c.name)[frames] for c in fields(RobotFrames)))
    update = {"frame_dt": float(np.median(np.diff(t))), **header}
    return Episode(
        episode.header.model_copy(update=update), t, tracks, contacts, robot,
        meshes=episode.meshes,
        channels={key: values[frames] for key, values in episode.channels.items()},
        path=episode.path,
    )  # fmt: skip


def cut_out(episode: Episode, begin: float, end: float) -> Episode:
    """The episode without what was recorded from ``begin`` to ``end`` (s)."""
    return resampled(episode, np.flatnonzero((episode.t < begin) | (episode.t >= end)))


def jittered(episode: Episode, step: int, share: float, seed: int = 0) -> NDArray[np.int64]:
    """Indices ``step`` frames apart, each off by up to that share of it."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(round(step * (1 - share)), round(step * (1 + share)) + 1, len(episode))
    at = np.concatenate([[0], np.cumsum(steps)])
    return at[at < len(episode)]
