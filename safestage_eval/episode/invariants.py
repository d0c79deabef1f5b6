"""What an episode must hold to be read as what it says, whatever file it came from.

NaN and infinite values stand for what was not measured: they are unknown where they are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError

from .header import SCHEMA_VERSION
from .rounding import most_off
from .scene_invariants import UNIT_TOLERANCE, check_bodies, check_cameras, check_joints

if TYPE_CHECKING:
    from .contacts import ContactTable
    from .episode import Episode
    from .frames import RobotFrames
    from .header import Header
    from .track import Track

_BLOCK = 1 << 13
"""Values whose squares are added up at once: of more than 10,000, OpenBLAS does it in several threads."""

ROUNDED = 0.02
"""Allowed deviation of a quaternion's norm from 1 that is stored in steps: in one byte it is 1/64."""


def check(episode: Episode) -> list[TraceError]:
    """Every broken invariant of the episode; empty when it is sound. Reads all of its columns."""
    where = str(episode.path or episode.header.episode_id)
    found = list(check_header(episode.header, where))
    found += check_time(episode.t, where)
    for body in episode.header.bodies:
        if body.name not in episode.tracks:
            found.append(TraceError(where, f"body {body.name!r} has no poses"))
            continue
        found += check_track(episode.tracks[body.name], body.name, len(episode), where)
    for geom in (g for body in episode.header.bodies for g in body.geoms):
        if geom.mesh is not None and geom.mesh not in episode.meshes:
            found.append(
                TraceError(where, f"geom {geom.name!r}: the mesh {geom.mesh[:12]}… is missing")
            )
    found += check_contacts(episode.contacts, episode.geom_owner, len(episode), where)
    found += check_frames(episode.frames, len(episode), where)
    for (body_name, name), values in episode.channels.items():
        if body_name not in episode.bodies:
            found.append(TraceError(where, f"channel {name!r} belongs to no body: {body_name!r}"))
        if len(values) != len(episode):
            found.append(
                TraceError(
                    where,
                    f"channel {name!r} of {body_name!r} has {len(values)} rows, "
                    f"time has {len(episode)}",
                )
            )
    return found


def check_header(header: Header, where: str, *, shapes: bool = True) -> Iterator[TraceError]:
    """Version, names, steps, gravity and shapes; ``shapes``: false where the bodies are known to be sound."""
    major = header.schema_version.partition(".")[0]
    if major != SCHEMA_VERSION.partition(".")[0]:
        yield TraceError(
            where,
            f"trace schema {header.schema_version} cannot be read by this version.",
            f"{SCHEMA_VERSION.partition('.')[0]}.x",
            "install a newer safestage" if major.isdigit() else "",
        )
    names = Counter(body.name for body in header.bodies)
    for name in sorted(name for name, times in names.items() if times > 1):
        yield TraceError(where, f"two bodies are named {name!r}", fix="give each body its own name")
    for step in ("physics_dt", "frame_dt", "control_dt"):
        value = getattr(header, step)
        if value is not None and not (np.isfinite(value) and value > 0):
            yield TraceError(where, f"{step} is {value}", "a positive number of seconds")
    if not np.isfinite(header.gravity).all():
        yield TraceError(where, f"gravity is {header.gravity}", "m/s², finite")
    for moment in ("success_time", "horizon", "post_success_hold"):
        value = getattr(header, moment)
        if value is not None and not np.isfinite(value):
            what = f"{moment} is {value}, a number that is not finite"
            yield TraceError(where, what, "seconds, or none")
    if shapes:
        yield from check_bodies(header.bodies, where)
    yield from check_joints(header.joints, where)
    filmed = () if header.video is None else header.video.cameras
    yield from check_cameras((*header.cameras, *filmed), names, where)


def check_time(t: NDArray[np.float64], where: str) -> list[TraceError]:
    """Finite and strictly increasing, at least one frame."""
    if len(t) == 0:
        return [TraceError(where, "the episode has no frames")]
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        what = f"time is not a finite number at row {bad[0]} ({len(bad)} values in all)."
        return [TraceError(where, what, "finite numbers")]
    back = np.flatnonzero(t[1:] <= t[:-1])
    if not len(back):
        return []
    i = int(back[0]) + 1
    return [
        TraceError(
            where,
            f"time does not increase at frame {i}: {t[i - 1]:.6f} s, then {t[i]:.6f} s.",
            "strictly increasing timestamps",
            "sort the frames by time and drop duplicates before writing",
        )
    ]


def check_track(track: Track, body: str, frames: int, where: str) -> list[TraceError]:
    """Row counts, and unit quaternions where they are numbers."""
    found = [
        TraceError(where, f"{name} of {body!r} has {len(column)} rows, time has {frames}")
        for name, column in track.columns.items()
        if len(column) not in (1, frames)
    ]
    array = track.orientation
    if near_unit(array):
        return found
    with np.errstate(all="ignore"):
        off = np.abs(np.sqrt(np.einsum("ij,ij->i", array, array, dtype=np.float64)) - 1)
    off[~np.isfinite(array).all(axis=1)] = 0.0
    bad = np.flatnonzero(off > UNIT_TOLERANCE)
    if len(bad):
        known = np.where(np.isfinite(array), array, np.float32(np.nan))
        bad = np.flatnonzero(off > UNIT_TOLERANCE + min(most_off(known), ROUNDED))
    if len(bad):
        i = int(bad[0])
        norm = float(np.sqrt((array[i].astype(np.float64) ** 2).sum()))
        found.append(
            TraceError(
                where,
                f"orientation of {body!r} at frame {i} has norm {norm:.4f} "
                f"({len(bad)} frames in all).",
                f"unit quaternions, wxyz, within {UNIT_TOLERANCE}",
                "normalise the quaternions, and check that they are not stored as Euler angles",
            )
        )
    return found


def sound_motion(
    position: NDArray[np.float32],
    orientation: NDArray[np.float32],
    linear_velocity: NDArray[np.float32],
    angular_velocity: NDArray[np.float32],
) -> bool:
    """Whether ``check_track`` finds nothing for sure in the values of any bodies, laid out one after the other."""
    columns = position, orientation, linear_velocity, angular_velocity
    return all(map(all_finite, columns)) and near_unit(orientation.reshape(-1, 4))


def near_unit(orientation: NDArray[np.float32]) -> bool:
    """Whether (…, 4) quaternions have unit norm for sure; faster than their norms."""
    with np.errstate(all="ignore"):
        parts = orientation * orientation
        square = parts[..., 0] + parts[..., 1] + parts[..., 2] + parts[..., 3]
        # an error of the square is half as large in the norm
        return bool(np.abs(square - 1).max(initial=0) < UNIT_TOLERANCE)


def check_frames(robot: RobotFrames, frames: int, where: str) -> list[TraceError]:
    """Row counts."""
    return [
        TraceError(where, f"{column.name} has {rows} rows, time has {frames}")
        for column in fields(robot)
        if (rows := len(getattr(robot, column.name))) != frames
    ]


def check_contacts(
    contacts: ContactTable, geom_owner: NDArray[np.int16], frames: int, where: str
) -> list[TraceError]:
    """Frames in range, body 1 before body 2, and geoms that belong to the bodies named with them.

    ``geom_owner`` (G,) is the body index of each geom, as in ``Episode.geom_owner``.
    """
    found = _in_range(contacts.frame, frames, "frame", where)
    if not (contacts.body1 < contacts.body2).all():
        found.append(TraceError(where, "contacts are not in canonical order: body1 >= body2"))
    for side in "12":
        geom, body = (getattr(contacts, f"{what}{side}") for what in ("geom", "body"))
        outside = _in_range(geom, len(geom_owner), f"geom{side}", where)
        found += outside
        if outside:
            continue
        wrong = np.flatnonzero(geom_owner[geom] != body)
        if len(wrong):
            row = int(wrong[0])
            found.append(
                TraceError(
                    where,
                    f"contact row {row}: geom{side} {geom[row]} does not belong to "
                    f"body{side} {body[row]} ({len(wrong)} rows in all).",
                    "geoms counted over all bodies in the header's order",
                )
            )
    return found


def _in_range(column: NDArray[np.integer], limit: int, name: str, where: str) -> list[TraceError]:
    if not len(column) or (column.min() >= 0 and column.max() < limit):
        return []
    outside = (column < 0) | (column >= limit)
    allowed = f"0…{limit - 1}" if limit else f"none: there is no {name.rstrip('12')}"
    return [TraceError(where, f"contact {name} {column[outside][0]} is out of range.", allowed)]


def all_finite(array: NDArray[np.floating]) -> bool:
    """Whether no value is infinite or NaN, for sure: false, too, where the sum of their squares is not.

    That is ten times as fast as looking at every value.
    """
    flat = array.reshape(-1)
    parts = (flat[i : i + _BLOCK] for i in range(0, len(flat), _BLOCK))
    return all(isfinite(np.vdot(part, part)) for part in parts)


def measured(array: NDArray[Any]) -> NDArray[Any]:
    """The values, with NaN for those that are infinite: neither was measured."""
    if array.dtype.kind != "f" or all_finite(array):
        return array
    return np.where(np.isfinite(array), array, np.float32(np.nan))
