"""Edits that take evidence away from an episode, in a way that the trace itself shows.

Not among them are lies that nobody could see: a bystander that is gone without having borne anything,
another material, a task's own limits, tags, one of several bodies that play a role.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from safestage_eval.episode import ContactTable, Episode, RobotFrames, Track

Edit = Callable[[Episode, np.random.Generator], tuple[str, Episode]]


def loaded(episode: Episode) -> Episode:
    """The same, of which nothing is left in the file."""
    contacts = episode.contacts
    tracks = {
        name: Track(*(getattr(track, f.name) for f in fields(Track)))
        for name, track in episode.tracks.items()
    }
    return replace(
        episode,
        tracks=tracks,
        _contacts=ContactTable(*(getattr(contacts, f.name) for f in fields(ContactTable))),
        _frames=episode.frames,
        states={},
    )


def header(episode: Episode, **changes: Any) -> Episode:
    """The episode with other header fields."""
    return replace(episode, header=episode.header.model_copy(update=changes))


def body(episode: Episode, name: str, **changes: Any) -> Episode:
    """The episode with other fields of one body."""
    bodies = tuple(
        b.model_copy(update=changes) if b.name == name else b for b in episode.header.bodies
    )
    return header(episode, bodies=bodies)


def some_body(episode: Episode, rng: np.random.Generator) -> str:
    """A body, mostly one that plays a role."""
    players = [name for names in episode.header.roles.values() for name in names]
    names = [b.name for b in episode.header.bodies]
    return str(rng.choice(players if players and rng.random() < 0.7 else names))


def stretch(frames: int, rng: np.random.Generator) -> slice:
    """Some frames, from a few to all."""
    if rng.random() < 0.2:
        return slice(0, frames)
    many = max(1, int(frames * rng.random() ** 2))
    first = int(rng.integers(0, frames - many + 1))
    return slice(first, first + many)


def selected(episode: Episode, keep: np.ndarray[Any, Any]) -> Episode:
    """The frames (T,) that are kept, with their own times."""
    number = np.cumsum(keep) - 1
    contacts = episode.contacts
    contacts = contacts.where(keep[contacts.frame])
    contacts = replace(contacts, frame=number[contacts.frame].astype(np.int32))
    tracks = {
        name: track
        if len(track) == 1
        else Track(*(getattr(track, f.name)[keep] for f in fields(Track)))
        for name, track in episode.tracks.items()
    }
    robot = RobotFrames(*(getattr(episode.frames, f.name)[keep] for f in fields(RobotFrames)))
    lost = None if episode.unseen is None else episode.unseen[keep]
    channels = {key: values[keep] for key, values in episode.channels.items()}
    return replace(
        episode, t=episode.t[keep], tracks=tracks, _contacts=contacts, _frames=robot,
        channels=channels, unseen=lost, states={},
    )  # fmt: skip


def with_track(episode: Episode, name: str, **columns: Any) -> Episode:
    """The episode with other columns of one track."""
    return replace(
        episode, tracks={**episode.tracks, name: replace(episode.tracks[name], **columns)}
    )


def pose_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Some column of a body, or all of its pose, is NaN for a while."""
    name = some_body(episode, rng)
    track = episode.tracks[name]
    columns = [f.name for f in fields(Track)]
    if rng.random() < 0.5:
        columns = [str(rng.choice(columns))]
    at, changed = stretch(len(track), rng), {}
    for column in columns:
        changed[column] = getattr(track, column).copy()
        changed[column][at] = np.nan
    return f"{name} {','.join(columns)} {at.start}:{at.stop}", with_track(episode, name, **changed)


def all_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Nothing was measured of any body for a while."""
    at = stretch(len(episode), rng)
    tracks = {}
    for name, track in episode.tracks.items():
        columns = [getattr(track, f.name).copy() for f in fields(Track)]
        for column in columns:
            if len(track) > 1:
                column[at] = np.nan
        tracks[name] = Track(*columns)
    return f"{at.start}:{at.stop}", replace(episode, tracks=tracks)


def unseen(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Frames at which nothing was recorded."""
    lost = np.zeros(len(episode), np.bool_) if episode.unseen is None else episode.unseen.copy()
    at = stretch(len(episode), rng)
    lost[at] = True
    return f"{at.start}:{at.stop}", replace(episode, unseen=lost)


def hole(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A stretch of frames is missing."""
    keep = np.ones(len(episode), np.bool_)
    at = stretch(len(episode), rng)
    keep[at] = False
    keep[[0, -1]] = True
    return f"{at.start}:{at.stop}", selected(episode, keep)


def thinned(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Only every nth frame."""
    step = int(2 ** rng.uniform(1, 6))
    found = selected(episode, np.arange(len(episode)) % step == 0)
    return f"every {step}", header(found, frame_dt=step * episode.header.frame_dt)


def late_start(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """The first frames are missing."""
    first = int(rng.integers(1, len(episode) - 1))
    return f"from {first}", selected(episode, np.arange(len(episode)) >= first)


def early_end(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """The last frames are missing."""
    last = int(rng.integers(2, len(episode)))
    return f"to {last}", selected(episode, np.arange(len(episode)) < last)


def contact_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Forces, peaks, places or normals of one pair, or of all, are NaN for a while."""
    contacts = episode.contacts
    column = str(rng.choice(["force", "peak_force", "position", "normal"]))
    at = stretch(len(episode), rng)
    rows = (contacts.frame >= at.start) & (contacts.frame < at.stop)
    where = "all"
    if contacts.pairs and rng.random() < 0.7:
        i, j = contacts.pairs[int(rng.integers(len(contacts.pairs)))]
        rows &= (contacts.body1 == i) & (contacts.body2 == j)
        where = f"{episode.header.bodies[i].name}-{episode.header.bodies[j].name}"
    values = getattr(contacts, column).copy()
    values[rows] = np.nan
    where = f"{column} {where} {at.start}:{at.stop}"
    return where, replace(episode, _contacts=replace(contacts, **{column: values}))


def bad_normals(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Normals are of another length, or point the other way."""
    by = float(rng.choice([0.0, 0.5, 3.0, -1.0]))
    contacts, at = episode.contacts, stretch(len(episode), rng)
    rows = (contacts.frame >= at.start) & (contacts.frame < at.stop)
    normal = np.where(rows[:, None], contacts.normal * np.float32(by), contacts.normal)
    text = f"x {by:g} {at.start}:{at.stop}"
    return text, replace(episode, _contacts=replace(contacts, normal=normal))


def no_forces(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """No contact forces, said so; or all of them zero, or no contact at all, not said so."""
    how = int(rng.integers(3))
    contacts = episode.contacts
    if how == 0:
        return "none", header(replace(episode, _contacts=ContactTable.empty()), force_source="none")
    if how == 1:
        return "no contacts", replace(episode, _contacts=ContactTable.empty())
    nothing = replace(
        contacts, force=np.zeros_like(contacts.force), peak_force=np.zeros_like(contacts.peak_force)
    )
    return "zero", replace(episode, _contacts=nothing)


def robot_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Joints, commands and gripper are NaN for a while, or absent."""
    at, columns = stretch(len(episode), rng), []
    absent = rng.random() < 0.3
    for f in fields(RobotFrames):
        values = getattr(episode.frames, f.name).copy()
        values[at] = np.nan
        columns.append(values[:, :0] if absent else values)
    return "absent" if absent else f"{at.start}:{at.stop}", replace(
        episode, _frames=RobotFrames(*columns)
    )


def role_unbound(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A role is not bound."""
    roles = dict(episode.header.roles)
    name = str(rng.choice(list(roles)))
    del roles[name]
    return name, header(episode, roles=roles)


def role_misspelt(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A role's name lacks a letter."""
    roles = dict(episode.header.roles)
    name = str(rng.choice(list(roles)))
    at = int(rng.integers(len(name)))
    roles[name[:at] + name[at + 1 :]] = roles.pop(name)
    return name, header(episode, roles=roles)


def header_unknown(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A header field is not told."""
    names = ["success", "success_time", "post_success_hold", "horizon", "termination", "goal"]
    names += ["control_dt", "stage", "force_source", "cameras"]
    name = str(rng.choice(names))
    changes: dict[str, Any] = {name: {"force_source": "none", "cameras": ()}.get(name)}
    if name == "success":
        changes["success_time"] = None
    return name, header(episode, **changes)


def body_unknown(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A field of a body, or of all bodies, is not told."""
    changes: dict[str, dict[str, Any]] = {
        "up_axis": {"up_axis": None, "untold": ("up_axis",)},
        "mass": {"mass": None},
        "geoms": {"geoms": (), "untold": ("cavity",), "cavity": None},
        "cavity": {"cavity": None, "untold": ("cavity",)},
        "finger": {"finger": None},
        "tcp": {"tcp": None},
        "inertia": {"inertia": None},
    }
    field = str(rng.choice(list(changes)))
    name = some_body(episode, rng)
    if field == "geoms":  # rows of contacts name geoms
        index = episode.body_index[name]
        contacts = episode.contacts
        away = (contacts.body1 == index) | (contacts.body2 == index)
        if away.any():
            episode = header(replace(episode, _contacts=ContactTable.empty()), force_source="none")
    if field in ("finger", "tcp") or rng.random() < 0.3:
        if field == "geoms":
            return f"{field} of {name}", body(episode, name, **changes[field])
        bodies = tuple(b.model_copy(update=changes[field]) for b in episode.header.bodies)
        return f"{field} of all", header(episode, bodies=bodies)
    return f"{field} of {name}", body(episode, name, **changes[field])


def velocities_gone(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Velocities of a body, or of all bodies, were not recorded: zero or NaN throughout."""
    how = float(rng.choice([0.0, np.nan]))
    columns = [["linear_velocity"], ["angular_velocity"], ["linear_velocity", "angular_velocity"]][
        int(rng.integers(3))
    ]
    names = list(episode.tracks) if rng.random() < 0.4 else [some_body(episode, rng)]
    for name in names:
        none = {c: np.full_like(getattr(episode.tracks[name], c), how) for c in columns}
        episode = with_track(episode, name, **none)
    return f"{','.join(columns)} of {len(names)} ({names[0]}) {how}", episode


def contacts_gone(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """All contacts of an object that contacts bear are missing, throughout or for a while.

    That shows: it neither falls nor is it borne. Not so of a few frames.
    """
    free = [b.name for b in free_bodies(episode)]
    name, at = str(rng.choice(free)), stretch(len(episode), rng)
    measured = np.isfinite(episode.track(name).position).all(axis=1)
    if episode.unseen is not None:
        measured &= ~episode.unseen
    if measured[at].sum() * episode.dt < 1.0:
        raise ValueError("nobody could see that")
    index, contacts = episode.body_index[name], episode.contacts
    own = (contacts.body1 == index) | (contacts.body2 == index)
    inside = (contacts.frame >= at.start) & (contacts.frame < at.stop)
    if not (own & inside).any():
        raise ValueError("it has none there")
    return f"{name} {at.start}:{at.stop}", replace(
        episode, _contacts=contacts.where(~(own & inside))
    )


def free_bodies(episode: Episode) -> list[Any]:
    """Objects with a mass that nothing is jointed to."""
    header = episode.header
    jointed = {b.parent for b in header.bodies} | {joint.body for joint in header.joints}
    return [
        b
        for b in header.bodies
        if b.kind == "object" and b.movable and b.geoms and b.mass
        and b.parent is None and b.name not in jointed
    ]  # fmt: skip


def gripper_removed(episode: Episode, _: np.random.Generator) -> tuple[str, Episode]:
    """The gripper's bodies, joints and contacts are gone; the links of the arm stay."""
    gone = [body.name for body in episode.header.bodies if body.kind == "gripper"]
    if not gone:
        raise ValueError("there is none")
    at = [i for i, joint in enumerate(episode.header.joints) if joint.body in gone]
    episode = without_joints(episode, set(at)) if at else episode
    for name in gone:
        episode = without(episode, name)
    return ", ".join(gone), episode


def pair_removed(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """All contacts of two bodies are gone, of which one is moved."""
    pairs = pairs_that_move(episode)
    if not pairs:
        raise ValueError("no touch set anything in motion")
    one, other = pairs[int(rng.integers(len(pairs)))]
    names = [episode.header.bodies[i].name for i in (one, other)]
    return "-".join(names), without_pair(episode, (one, other))


def without_pair(episode: Episode, pair: tuple[int, int]) -> Episode:
    """The episode without the contacts of two bodies."""
    contacts = episode.contacts
    kept = contacts.where((contacts.body1 != pair[0]) | (contacts.body2 != pair[1]))
    return replace(episode, _contacts=kept)


def pairs_that_move(episode: Episode) -> list[tuple[int, int]]:
    """Pairs of movable bodies that touch, of which an object goes 5 mm or more."""
    bodies, found = episode.header.bodies, []
    for pair in episode.contacts.pairs:
        if not all(bodies[i].movable for i in pair):
            continue
        objects = [bodies[i].name for i in pair if bodies[i].kind == "object"]
        places = (episode.track(name).position for name in objects)
        if any(np.ptp(place, axis=0).max() >= 0.005 for place in places):
            found.append(pair)
    return found


def joints_untold(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A joint, or every joint, is not in the header; its columns are gone too."""
    joints = episode.header.joints
    if not joints:
        raise ValueError("there is none")
    lost = set(range(len(joints)) if rng.random() < 0.5 else [int(rng.integers(len(joints)))])
    return f"{sorted(lost)}", without_joints(episode, lost)


def without_joints(episode: Episode, lost: set[int]) -> Episode:
    """The episode without some joints, given by their numbers."""
    joints = episode.header.joints
    keep = [i for i in range(len(joints)) if i not in lost]
    columns = {
        name: getattr(episode.frames, name)[:, keep]
        for name in ("joint_position", "joint_velocity", "joint_torque")
        if getattr(episode.frames, name).shape[1] == len(joints)
    }
    found = replace(episode, _frames=replace(episode.frames, **columns))
    return header(found, joints=tuple(joints[i] for i in keep))


def body_removed(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A body is not in the header any more, nor are its poses and contacts.

    It shows where a joint or another body names it, or where it bore what rests: its roles are unbound
    then. Otherwise a role must name it still.
    """
    given = episode.header
    name = str(rng.choice([b.name for b in given.bodies]))
    roles = {role: who for role, who in given.roles.items() if name not in who}
    found = without(episode, name)
    named = {b.parent for b in given.bodies} | {joint.body for joint in given.joints}
    if name in named or name in bearers(episode):
        return name, header(found, roles=roles)
    if len(roles) == len(given.roles):
        raise ValueError("nobody could see that it is gone")
    return name, found


def bearers(episode: Episode) -> set[str]:
    """Bodies that alone bore something for a second or longer."""
    found, bodies = set(), episode.header.bodies
    for body in free_bodies(episode):
        i = episode.body_index[body.name]
        others = {j: episode.contacts.rows((min(i, j), max(i, j))) for j in range(len(bodies))}
        frames = {j: np.unique(episode.contacts.frame[rows]) for j, rows in others.items()}
        for j, own in frames.items():
            rest = [v for k, v in frames.items() if k != j and len(v)]
            alone = np.setdiff1d(own, np.concatenate(rest)) if rest else own
            if len(alone) * episode.dt > 1.0:
                found.add(bodies[j].name)
    return found


def without(episode: Episode, name: str) -> Episode:
    """The episode without a body; roles stay as they are."""
    index, contacts = episode.body_index[name], episode.contacts
    geoms = np.flatnonzero(episode.geom_owner == index)
    contacts = contacts.where((contacts.body1 != index) & (contacts.body2 != index))
    columns = {}
    for side in "12":
        one, geom = getattr(contacts, f"body{side}"), getattr(contacts, f"geom{side}")
        columns[f"body{side}"] = (one - (one > index)).astype(np.int16)
        if len(geoms):
            geom = (geom - len(geoms) * (geom > geoms[-1])).astype(np.uint16)
        columns[f"geom{side}"] = geom
    bodies = tuple(b for b in episode.header.bodies if b.name != name)
    tracks = {key: track for key, track in episode.tracks.items() if key != name}
    found = replace(episode, tracks=tracks, _contacts=replace(contacts, **columns))
    return header(found, bodies=bodies)


EDITS: dict[str, Edit] = {
    edit.__name__: edit
    for edit in (
        pose_nan, all_nan, unseen, hole, thinned, late_start, early_end, contact_nan, bad_normals,
        no_forces, robot_nan, role_unbound, role_misspelt, header_unknown, body_unknown,
        body_removed, velocities_gone, contacts_gone, joints_untold, gripper_removed, pair_removed,
    )
}  # fmt: skip


def resampled(episode: Episode, rate: float) -> Episode | None:
    """The frames nearest to an even clock; None of an episode that has no more to begin with."""
    if episode.dt > 0.99 / rate:
        return None
    clock = np.arange(episode.t[0], episode.t[-1] + 1e-6, 1 / rate)
    keep = np.zeros(len(episode), np.bool_)
    keep[np.abs(episode.t[:, None] - clock).argmin(axis=0)] = True
    return header(selected(episode, keep), frame_dt=1 / rate)


def with_holes(episode: Episode) -> Episode:
    """Poses, forces and joints are NaN in places that the episode's name determines."""
    rng = np.random.default_rng(zlib.crc32(episode.header.episode_id.encode()))
    kinds = ("pose_nan", "pose_nan", "contact_nan", "robot_nan", "all_nan")
    for kind in kinds[: rng.integers(2, 6)]:
        episode = EDITS[kind](episode, rng)[1]
    return episode
