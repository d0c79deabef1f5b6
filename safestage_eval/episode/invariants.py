"""Invariants of every episode, whatever file it came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError

from .clock_invariants import check_clock
from .contradiction import doubt
from .header import SCHEMA_VERSION
from .rounding import most_off
from .scene_invariants import UNIT_TOLERANCE, check_bodies, check_cameras, check_joints

if TYPE_CHECKING:
    from .contacts import ContactTable
    from .episode import Episode
    from .frames import RobotFrames
    from .header import Header
    from .track import Track

CONTACT_VALUES = ("position", "normal", "force", "peak_force", "depth")
"""Columns of contacts that are measured."""

_BLOCK = 1 << 13
"""Values whose squares are added up at once: of more than 10,000, OpenBLAS does it in several threads."""

ROUNDED = 0.02
"""Allowed deviation of a quaternion's norm from 1 that is stored in steps: in one byte it is 1/64."""

LEVEL = 1e-3
"""Allowed sine of the angle between gravity and −z: rounding, no slope."""


def check(episode: Episode) -> list[TraceError]:
    """Every broken invariant of the episode; empty when it is sound. Reads all of its columns."""
    where = str(episode.path or episode.header.episode_id)
    found = list(check_header(episode.header, where))
    found += check_time(episode.t, where)
    found += check_clock(episode.header, episode.t, where)
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
        found += check_finite(values, f"channel {name} of {body_name}", where)
    return found


def check_header(header: Header, where: str, *, shapes: bool = True) -> Iterator[TraceError]:
    """Version, names, roles and shapes; ``shapes``: false where the bodies are known to be sound."""
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
    joints = {joint.name for joint in header.joints}  # as goals of drawers and knobs ask for
    for role, players in header.roles.items():
        for player in players:
            if player not in names and player not in joints:
                yield doubt(
                    f"role {role!r} names {player!r}, which is no body and no joint",
                    ", ".join(names),
                    bodies=(player,),
                    where=where,
                    code="AUD151",
                )
    for step in ("physics_dt", "frame_dt", "control_dt"):
        value = getattr(header, step)
        if value is not None and not (np.isfinite(value) and value > 0):
            what = f"{step} is {value}"
            yield doubt(what, "a positive number of seconds", where=where, code="AUD107")
    x, y, z = header.gravity
    if not (np.isfinite(header.gravity).all() and z < 0 and np.hypot(x, y) <= LEVEL * -z):
        yield doubt(
            f"gravity is {header.gravity}",
            "m/s² along −z of the world",
            "record in a world whose z axis points up",
            where=where,
            code="AUD113",
        )
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
    found = check_finite(t, "time", where, gaps=False)
    back = np.flatnonzero(t[1:] <= t[:-1])  # a difference of infinities is none
    if len(back) and not found:
        i = int(back[0]) + 1
        found.append(
            doubt(
                f"time does not increase at frame {i}: {t[i - 1]:.6f} s, then {t[i]:.6f} s.",
                "strictly increasing timestamps",
                "sort the frames by time and drop duplicates before writing",
                where=where,
                code="AUD100",
            )
        )
    return found


def check_track(track: Track, body: str, frames: int, where: str) -> list[TraceError]:
    """Row count, finite values, unit quaternions."""
    return [
        error
        for name, column in track.columns.items()
        for error in _check_column(name, column, body, frames, where)
    ]


def _check_column(
    column: str, array: NDArray[np.float32], body: str, frames: int, where: str
) -> list[TraceError]:
    found = []
    if len(array) not in (1, frames):
        found.append(
            TraceError(where, f"{column} of {body!r} has {len(array)} rows, time has {frames}")
        )
    found += check_finite(array, f"{column} of {body!r}", where)
    if column != "orientation" or found:
        return found
    if near_unit(array):
        return found
    norm = np.sqrt(np.einsum("ij,ij->i", array, array, dtype=np.float64))
    off = np.flatnonzero(np.abs(norm - 1) > UNIT_TOLERANCE)  # false of NaN
    if len(off):
        off = np.flatnonzero(np.abs(norm - 1) > UNIT_TOLERANCE + min(most_off(array), ROUNDED))
    if len(off):
        i = int(off[0])
        found.append(
            doubt(
                f"orientation of {body!r} at frame {i} has norm {norm[i]:.4f} "
                f"({len(off)} frames in all).",
                f"unit quaternions, wxyz, within {UNIT_TOLERANCE}",
                "normalise the quaternions, and check that they are not stored as Euler angles",
                bodies=(body,),
                where=where,
                code="AUD100",
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
    """Row counts and finite values."""
    found = []
    for column in fields(robot):
        array = getattr(robot, column.name)
        if len(array) != frames:
            found.append(
                TraceError(where, f"{column.name} has {len(array)} rows, time has {frames}")
            )
        found += check_finite(array, column.name, where)
    return found


def check_contacts(
    contacts: ContactTable, geom_owner: NDArray[np.int16], frames: int, where: str
) -> list[TraceError]:
    """Finite values, frames in range, and geoms that belong to the bodies named with them.

    ``geom_owner`` (G,) is the body index of each geom, as in ``Episode.geom_owner``.
    """
    found = _in_range(contacts.frame, frames, "frame", where)
    if not (contacts.body1 < contacts.body2).all():
        found.append(TraceError(where, "contacts are not in canonical order: body1 >= body2"))
    for side in "12":
        geom, body = getattr(contacts, f"geom{side}"), getattr(contacts, f"body{side}")
        outside = _in_range(geom, len(geom_owner), f"geom{side}", where)
        wrong = np.flatnonzero(geom_owner[geom] != body) if not outside else np.zeros(0, np.intp)
        found += outside
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
    for name in CONTACT_VALUES:
        found += check_finite(getattr(contacts, name), f"contact {name}", where)
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


def check_finite(
    array: NDArray[np.floating], name: str, where: str, *, gaps: bool = True
) -> list[TraceError]:
    """No infinity, and no NaN unless ``gaps``: there it says that nothing was measured.

    The first such row is named.
    """
    if all_finite(array):
        return []
    bad = np.isinf(array) if gaps else ~np.isfinite(array)
    if not bad.any():
        return []
    first = int(np.argwhere(bad)[0][0])
    return [
        TraceError(
            where,
            f"{name} is not a finite number at row {first} ({int(bad.sum())} values in all).",
            "finite numbers, and NaN for what was not measured" if gaps else "finite numbers",
        )
    ]
