"""Other recordings of the same rollout: what changes in the data and must not change the verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from resampled import resampled

from safestage_eval.episode import Body, ContactTable, Episode, Header, RobotFrames, Track
from safestage_eval.geometry.pose import matrix

F64 = NDArray[np.float64]


def multiplied(first: F64, second: F64) -> F64:
    """(..., 4) Hamilton product of quaternions, wxyz."""
    w1, x1, y1, z1 = np.moveaxis(np.asarray(first, float), -1, 0)
    w2, x2, y2, z2 = np.moveaxis(np.asarray(second, float), -1, 0)
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=-1,
    )


def moved(episode: Episode, yaw: float, shift: Sequence[float]) -> Episode:
    """The whole scene turned about world z by ``yaw`` (rad), then shifted by (3,) m."""
    quaternion = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    turn = matrix(quaternion)

    def track(old: Track) -> Track:
        return Track(
            (old.position @ turn.T + np.asarray(shift)).astype(np.float32),
            multiplied(quaternion, old.orientation).astype(np.float32),
            (old.linear_velocity @ turn.T).astype(np.float32),
            (old.angular_velocity @ turn.T).astype(np.float32),
        )

    c = episode.contacts
    contacts = ContactTable.build(
        c.frame, c.body1, c.body2, c.geom1, c.geom2, c.position @ turn.T + np.asarray(shift),
        c.normal @ turn.T, c.force @ turn.T, c.peak_force, c.depth,
    )  # fmt: skip
    tracks = {name: track(old) for name, old in episode.tracks.items()}
    return rebuilt(episode, tracks=tracks, contacts=contacts)


def renamed(episode: Episode, new: Callable[[str], str]) -> Episode:
    """Every body under another name, wherever it is named."""

    def body(old: Body) -> Body:
        return old.model_copy(
            update={
                "name": new(old.name),
                "parent": None if old.parent is None else new(old.parent),
                "excluded": tuple(map(new, old.excluded)),
            }
        )

    header = episode.header
    joints = tuple(
        joint.model_copy(update={"body": None if joint.body is None else new(joint.body)})
        for joint in header.joints
    )
    roles = {role: tuple(map(new, players)) for role, players in header.roles.items()}
    changes = {"bodies": tuple(map(body, header.bodies)), "joints": joints, "roles": roles}
    return rebuilt(
        episode,
        header=header.model_copy(update=changes),
        tracks={new(name): track for name, track in episode.tracks.items()},
        channels={(new(name), what): x for (name, what), x in episode.channels.items()},
    )


def permuted(episode: Episode, order: Sequence[int], rows: NDArray[np.intp]) -> Episode:
    """Bodies listed in another ``order`` (B,), contacts given in another order of ``rows`` (C,)."""
    header = episode.header
    place = np.argsort(order)  # old index of a body → new index
    counts = [len(body.geoms) for body in header.bodies]
    first = np.cumsum([0, *counts])
    geoms = np.concatenate([np.arange(first[b], first[b + 1]) for b in order])
    geom_place = np.argsort(geoms)
    c = episode.contacts.where(rows)
    contacts = ContactTable.build(
        c.frame, place[c.body1], place[c.body2], geom_place[c.geom1], geom_place[c.geom2],
        c.position, c.normal, c.force, c.peak_force, c.depth,
    )  # fmt: skip
    bodies = tuple(header.bodies[b] for b in order)
    return rebuilt(episode, header=header.model_copy(update={"bodies": bodies}), contacts=contacts)


def every_second(episode: Episode) -> Episode:
    """The rollout recorded at half the rate."""
    return resampled(episode, np.arange(0, len(episode), 2), frame_dt=2 * episode.header.frame_dt)


def cut_off(episode: Episode, count: int) -> Episode:
    """The first so many frames of the same rollout, of which the rest was lost."""
    return resampled(episode, np.arange(count), termination="truncated")


def gone_on(episode: Episode, count: int) -> Episode:
    """The rollout with ``count`` more frames in which everything stays as it is in the last."""
    last, dt = len(episode) - 1, episode.dt
    t = np.concatenate([episode.t, episode.t[-1] + dt * np.arange(1, count + 1)])

    def longer(column: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([column, np.repeat(column[-1:], count, axis=0)])

    def track(old: Track) -> Track:
        if len(old) == 1:
            return old
        still = np.zeros((count, 3), np.float32)
        return Track(
            longer(old.position), longer(old.orientation),
            np.concatenate([old.linear_velocity, still]),
            np.concatenate([old.angular_velocity, still]),
        )  # fmt: skip

    c = episode.contacts
    ends = np.flatnonzero(c.frame == last)
    rows = np.concatenate([np.arange(len(c)), np.tile(ends, count)])
    more = c.where(rows)
    frame = np.concatenate([c.frame, np.repeat(last + 1 + np.arange(count), len(ends))])
    contacts = replace(more, frame=frame.astype(np.int32))
    frames = RobotFrames(*(longer(getattr(episode.frames, f.name)) for f in fields(RobotFrames)))
    return rebuilt(
        episode, t=t, contacts=contacts, frames=frames,
        tracks={name: track(old) for name, old in episode.tracks.items()},
        channels={key: longer(values) for key, values in episode.channels.items()},
    )  # fmt: skip


def rebuilt(
    episode: Episode,
    *,
    header: Header | None = None,
    t: F64 | None = None,
    tracks: Mapping[str, Track] | None = None,
    contacts: ContactTable | None = None,
    frames: RobotFrames | None = None,
    channels: Mapping[tuple[str, str], NDArray[np.float32]] | None = None,
) -> Episode:
    """The episode with some of its parts exchanged."""
    return Episode(
        header or episode.header,
        episode.t if t is None else t,
        tracks or episode.tracks,
        contacts or episode.contacts,
        frames or episode.frames,
        meshes=episode.meshes,
        channels=episode.channels if channels is None else channels,
    )
