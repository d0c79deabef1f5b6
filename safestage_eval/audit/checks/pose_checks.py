"""Checks of poses and velocities: their unit, their quaternions, jumps and gaps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.quaternion_order import (
    standing_otherwise,
    turning_otherwise,
    upright_otherwise,
)
from safestage_eval.audit.repair import LENGTHS
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import Severity, check
from safestage_eval.episode.invariants import all_finite
from safestage_eval.episode.runs import runs
from safestage_eval.evidence.missing_values import POSE, TWIST

FARTHEST = 50.0
"""m; a scene in front of an arm is no wider."""

NEAREST = 0.02
"""m; nor does an arm reach over less."""


@check(
    "AUD101",
    "error",
    title="lengths are not in metres",
    why="Every distance, height, speed and force of weight is compared with limits in SI units.",
    example="a table whose top is at z = 80 (centimetres)",
    issue="osrf/drcsim#275",
)
def length_unit(subject: Subject) -> Iterator[Defect]:
    """Compares poses with velocities, contacts, shapes and weights; names the unit in which they fit.

    Without any of these it looks for scenes wider than 50 m, and for robots smaller than 2 cm.
    """
    yield from subject.explained("AUD101")
    if subject.diagnosis.repair is not None or not subject.readable:
        return
    places = [
        subject.track(body.name).position[[0, -1]]
        for body in subject.header.bodies
        if body.name in subject.episode.tracks and body.kind in ("robot", "gripper", "object")
    ]
    if len(places) < 2:
        return
    points = np.concatenate(places).astype(float)
    with np.errstate(all="ignore"):
        # nanmedian takes ten times as long
        median = np.median if all_finite(points) else np.nanmedian
        wide = float(np.nanmax(np.linalg.norm(points - median(points, axis=0), axis=1)))
        middle = float(median(np.linalg.norm(points - np.nanmean(points, axis=0), axis=1)))
    if middle > FARTHEST or 0 < wide < NEAREST:
        yield Defect(
            f"the robot and its objects are spread over {wide:.3g} m.",
            "write positions in metres",
            f"positions are in {_unit(middle if middle > FARTHEST else wide)}",
            field="bodies.position",
        )


def _unit(size: float) -> str:
    fits = [name for by, name in LENGTHS.items() if 0.05 < size * by < 3]
    return fits[0] if fits else "another unit"


@check(
    "AUD111",
    "error",
    title="quaternions are not w, x, y, z",
    why="Tilt, toppling, shapes and every clearance hang on orientations.",
    example="(0, 0, 0, 1) for a body that is not turned",
    issue="isaac-sim/IsaacLab#5754",
    unless=("AUD101",),
    cheap=True,
)
def quaternion_order(subject: Subject) -> Iterator[Defect]:
    """Compares orientations with angular velocities and with what objects stand on, in both orders.

    Then it asks for objects that stand upright in the other order alone, and counts bodies at
    (0, 0, 0, ±1). In the order x, y, z, w that is a body that is not turned; as w, x, y, z it is one
    turned by exactly 180° about z, which two bodies of a scene rarely are, nor the only one that can move.
    """
    yield from subject.explained("AUD111")
    if subject.diagnosis.repair is not None or not subject.readable:
        return
    for names, what in (turning_otherwise(subject), standing_otherwise(subject)):
        if names:
            yield _exchanged(what, names)
            return
    names, what = upright_otherwise(subject)
    if names:
        yield _exchanged(what, names, "warning")
        return
    [alone] = moving if len(moving := [b.name for b in subject.objects]) == 1 else [""]
    if alone and (abs(subject.track(alone).orientation) == (0, 0, 0, 1)).all():
        what = f"{alone!r} is at exactly (0, 0, 0, 1): as w, x, y, z that is half a turn about z."
        yield _exchanged(what, (alone,), "warning")
        return
    if not subject.whole:
        return
    first = {
        body.name: subject.track(body.name).orientation[0]
        for body in subject.header.bodies
        if body.name in subject.episode.tracks
    }
    last = [name for name, q in first.items() if abs(q[3]) > 1 - 1e-6]
    upright = [name for name, q in first.items() if abs(q[0]) > 1 - 1e-6]
    if len(last) < 2 or upright:
        return
    what = (
        f"{len(last)} bodies ({', '.join(last[:3])}{', …' * (len(last) > 3)}) begin at exactly "
        "(0, 0, 0, 1), and none at (1, 0, 0, 0)."
    )
    yield _exchanged(what, (), "error" if len(last) > len(first) / 3 else "warning")


def _exchanged(what: str, names: tuple[str, ...], severity: Severity | None = None) -> Defect:
    return Defect(
        what,
        "write quaternions as w, x, y, z; a body that is not turned is at (1, 0, 0, 0)",
        "quaternions are stored as x, y, z, w",
        bodies=names,
        field="bodies.orientation",
        severity=severity,
    )


@check(
    "AUD112",
    "note",
    title="quaternions change their sign",
    why="q and -q are the same orientation, and are judged alike; but whoever interpolates or averages "
    "them gets a spin that never was.",
    example="(0.7, 0, 0, 0.7), then (-0.7, 0, 0, -0.7)",
    unless=("AUD111",),
)
def quaternion_signs(subject: Subject) -> Iterator[Defect]:
    """Counts steps over which the product of two quaternions is below zero and the turn is small."""
    if not subject.readable:
        return
    flips, names = 0, []
    for body in subject.objects:
        q = subject.track(body.name).orientation
        if len(q) > 1:
            count = int((np.einsum("ij,ij->i", q[1:], q[:-1]) < -0.9).sum())
            flips += count
            names += [body.name] * bool(count)
    if flips:
        yield Defect(
            f"quaternions of {', '.join(names[:3])}{', …' * (len(names) > 3)} change their sign "
            f"{flips} times.",
            "negate a quaternion whose product with the one before is below zero",
            bodies=tuple(names),
            field="bodies.orientation",
        )


@check(
    "AUD119",
    "warning",
    title="poses or velocities are not measured at every frame",
    why="Whatever rests on them is unknown at these frames: a rule that looks there is inconclusive, or "
    "violated by what is seen around them; never passed.",
    example="the position of a cube that a tracker lost from 2.0 to 2.5 s, written as NaN",
)
def not_measured(subject: Subject) -> Iterator[Defect]:
    """Looks for NaN and infinite poses and velocities; velocities that are NaN throughout were not recorded."""
    t = subject.episode.t
    for body in subject.header.bodies if subject.readable else ():
        if body.name not in subject.episode.tracks:
            continue
        track, lost = subject.track(body.name), dict[str, NDArray[np.bool_]]()
        stored = subject.given.tracks[body.name]
        for column in (*POSE, *TWIST):
            values = getattr(track, column)
            if all_finite(values):
                continue
            gone = ~np.isfinite(values).all(axis=1)
            if gone.any() and not (column in TWIST and gone.all()):
                lost[column] = gone
        if not lost:
            continue
        some = np.logical_or.reduce([*lost.values()])
        spans = runs(some)
        first, last = (float(t[min(i, len(t) - 1)]) for i in (spans[0][0], spans[-1][1] - 1))
        names = " and ".join(column.replace("_", " ") for column in lost)
        number = "infinite" if any(np.isinf(getattr(stored, c)).any() for c in lost) else "NaN"
        often = f", {len(spans)} times" if len(spans) > 1 else ""
        yield Defect(
            f"{names} of {body.name!r} {'is' if len(lost) == 1 else 'are'} {number} in {some.sum()} of "
            f"{len(some)} frames ({100 * some.mean():.2g} %), from {first:.2f} s to {last:.2f} s{often}.",
            "record poses and velocities of every body at every frame",
            "the tracker or the simulator lost the body",
            bodies=(body.name,),
            field=f"bodies.{next(iter(lost))}",
            time=first,
        )
