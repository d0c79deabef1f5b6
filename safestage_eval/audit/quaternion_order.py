"""Whether a recording makes sense only with its quaternions read as x, y, z, w.

Each question is asked twice, of the quaternions as they are written and of the same numbers in the
other order: how bodies turn, compared with their angular velocities, at any rate at which they turn by
less than half a turn from one sample to the next; and what objects stand on before anything moves.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from safestage_eval.doubts.column_comparisons import turns
from safestage_eval.episode import Body, Episode, Mesh, Track
from safestage_eval.episode.scene_shapes import PLANE, body_shapes, world_boxes
from safestage_eval.geometry.pose import matrix

from .subject import Subject

F64 = NDArray[np.float64]
Told = tuple[tuple[str, ...], str]
"""Names of the bodies that tell, and what they tell; both empty where none does."""

TURNED = 0.3
"""rad that a body turns, step by step added up, before its turns are compared."""

SLOW = 1.5
"""rad; a step over which a body turns by more, as its velocity has it, is left out."""

FITS, SURE, BETTER = 0.5, 0.25, 3.0
"""Shares of the turns by which angular velocities differ from them at the most in the right order, at low
rates and usually; and how many times as much they differ in a wrong one."""

STANDS, OFF = 2e-3, 6e-3
"""m between an object and what it stands on; and from where on it floats above it or pierces it."""

NO_TILT = 1e-3
"""Size of x and y of a quaternion below which it turns about z alone."""

LEANS, UPRIGHT = 0.9, 0.9999
"""Cosines of the tilt of a body that has toppled, and of one that stands."""

SEEN = 0.1
"""m above or below an object within which its support is looked for."""


def _other_order(quaternions: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.roll(quaternions, 1, axis=-1)


def turning_otherwise(subject: Subject) -> Told:
    """Bodies that turn as their angular velocities say only in the other order."""
    if not subject.whole:
        return (), ""
    t, better = subject.episode.t, list[str]()
    for body in subject.header.bodies:
        track = subject.episode.tracks.get(body.name)
        if track is None or len(track) != len(t) or len(t) < 2:
            continue
        rate = track.angular_velocity.astype(np.float64)
        said = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)[:, None]
        size = np.sqrt(np.einsum("ij,ij->i", said, said))
        known = size < SLOW
        if not size[known].sum() > TURNED:
            continue
        off, most = _difference(track.orientation, said, known)
        if off < SURE * most:  # they are in the right order
            return (), ""
        other, _ = _difference(_other_order(track.orientation), said, known)
        if other < FITS * most and off > BETTER * other:
            better.append(body.name)
    if not better:
        return (), ""
    return tuple(better), (
        f"{_named(better)} turn{'s' * (len(better) == 1)} otherwise than the angular velocities say, and "
        "as they say if the numbers are read as x, y, z, w."
    )


def _difference(
    quaternions: NDArray[np.float32], said: F64, known: NDArray[np.bool_]
) -> tuple[float, float]:
    """By how much (rad) turns differ from what velocities say, step by step; how much these say."""
    went = turns(quaternions)
    known = known & np.isfinite(went).all(axis=1)
    off = np.linalg.norm(went - said, axis=1)[known]
    return float(off.sum()), float(np.linalg.norm(said, axis=1)[known].sum())


def standing_otherwise(subject: Subject) -> Told:
    """Objects that stand at the first frame only in the other order, and float or pierce in this one."""
    episode = subject.episode
    if not len(episode):
        return (), ""
    as_written, other = (_gaps(subject, episode, swap) for swap in (False, True))
    better = [
        n
        for n, gap in as_written.items()
        if abs(gap) > OFF
        and abs(other.get(n, np.inf)) < STANDS
        and not _about_z(episode.tracks[n].orientation[0])  # which the other order hardly makes
    ]
    worse = [
        n for n, gap in as_written.items() if abs(gap) < STANDS and abs(other.get(n, 0.0)) > OFF
    ]
    if not better or worse:
        return (), ""
    gap = as_written[better[0]]
    does = f"floats {1e3 * gap:.0f} mm above" if gap > 0 else f"pierces by {-1e3 * gap:.0f} mm"
    more = f" (and {len(better) - 1} more alike)" if len(better) > 1 else ""
    return tuple(better), (
        f"{better[0]!r} begins so turned that it {does} what is below it{more}, and stands on it if the "
        "numbers are read as x, y, z, w."
    )


def _about_z(quaternion: NDArray[np.float32]) -> bool:
    """Whether it turns about z alone."""
    return bool(abs(quaternion[1:3]).max() < NO_TILT)


def upright_otherwise(subject: Subject) -> Told:
    """Objects that begin toppled by half a turn as written, and upright in the other order.

    What stands upright and is turned about z has no x and no y: w and x are 0 in the wrong order.
    """
    found = []
    for body in subject.objects:
        if body.up_axis is None or body.name not in subject.episode.tracks:
            continue
        q = subject.episode.tracks[body.name].orientation[0]
        other = _other_order(q)
        if not (np.isfinite(q).all() and q.any() and _about_z(other)):
            continue
        axis = np.asarray(body.up_axis)
        up, then = (float((matrix(x.astype(np.float64)) @ axis)[2]) for x in (q, other))
        if up < LEANS and then > UPRIGHT:
            found.append(body.name)
    if not found:
        return (), ""
    return tuple(found), (
        f"{_named(found)} begin{'s' * (len(found) == 1)} toppled, at a quaternion without w and x, and "
        "upright if the numbers are read as x, y, z, w."
    )


def _gaps(subject: Subject, episode: Episode, swap: bool) -> Mapping[str, float]:
    """Object → m between its lowest point and what is nearest to that below its middle; <0 if inside."""
    spans = dict[str, tuple[F64, F64]]()
    for body in subject.header.bodies:
        if body.kind in ("region", "robot", "gripper") or body.name not in episode.tracks:
            continue
        span = _span(body, episode.tracks[body.name], episode.meshes, swap)
        if span is not None:
            spans[body.name] = span
    gaps = {}
    for body in subject.objects:
        if body.parent is not None or body.name not in spans:
            continue
        low, high = spans[body.name]
        middle = (low + high)[:2] / 2
        tops = [
            low[2] - top[2]
            for name, (bottom, top) in spans.items()
            if name != body.name and (bottom[:2] <= middle).all() and (middle <= top[:2]).all()
        ]
        near = [gap for gap in tops if abs(gap) < SEEN]
        if near:
            gaps[body.name] = min(near, key=abs)
    return gaps


def _span(
    body: Body, track: Track, meshes: Mapping[str, Mesh], swap: bool
) -> tuple[F64, F64] | None:
    """Corners (3,) of the box around a body at the first frame; None where it is not known."""
    shapes = body_shapes(body, meshes)
    quaternion, place = track.orientation[0], track.position[0].astype(np.float64)
    if shapes is None or not (np.isfinite(quaternion).all() and np.isfinite(place).all()):
        return None
    turn = matrix((_other_order(quaternion) if swap else quaternion).astype(np.float64))
    low, high = world_boxes(shapes, turn, place)
    planes = shapes.kind == PLANE
    if ((turn @ shapes.axes)[planes, 2, 2] < 1 - 1e-6).any():
        return None
    low[planes, :2], high[planes, :2] = -np.inf, np.inf
    return low.min(axis=0), high.max(axis=0)


def _named(names: list[str]) -> str:
    return f"{names[0]!r}{f' and {len(names) - 1} more bodies' if len(names) > 1 else ''}"
