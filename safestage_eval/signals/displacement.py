"""How far a body is from where it was, and from the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval, hide

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request


NORM = Option(
    "norm",
    "choice",
    "How the coordinates add up: l2 (the distance), l1 (the sum) or max (the largest).",
    choices=("l2", "l1", "max"),
)


POINT = Option(
    "point",
    "choice",
    "The point of the body that is looked at: its center of mass, or the origin of its frame.",
    choices=("center", "origin"),
    reads=(("origin", "origin"),),
)


def _displacement(request: Request, axes: int) -> Interval:
    """m, of a point of the body from the reference, over the first 2 or 3 coordinates."""
    from safestage_eval.geometry.lengths import distances

    place, reference = request.place, request.reference
    there = reference.of(place, reference.baseline.position(place))
    order = {"l1": 1, "max": np.inf}.get(str(request.option("norm")))
    if order is None:
        one = there[:1] if there.strides[0] == 0 else there
        return request.exact(distances(place, one, axes), reference.baseline.notes)
    moved = np.linalg.norm((place - there)[:, :axes], order, axis=1)
    return request.exact(moved, reference.baseline.notes)


@signal(
    "displacement", "length", args=("a",), needs=("poses",), since=True, from_start=True,
    options=(NORM, POINT), reads="com", metric=True,
)  # fmt: skip
def displacement(request: Request) -> Interval:
    """Distance of the centre of mass from where it was at the reference."""
    return _displacement(request, 3)


@signal(
    "displacement_xy", "length", args=("a",), needs=("poses",), since=True, from_start=True,
    options=(NORM, POINT), reads="com", metric=True,
)  # fmt: skip
def displacement_xy(request: Request) -> Interval:
    """Horizontal distance of the centre of mass from where it was at the reference."""
    return _displacement(request, 2)


@signal("remoteness", "length", args=("a",), needs=("poses",), scale=1.0, reads="com")
def remoteness(request: Request) -> Interval:
    """Distance of the centre of mass from the robot's base; of a robot without a fixed one, from
    the nearest of its bodies.

    m, between the centre of mass and the origins of the robot's bodies.
    """
    from safestage_eval.geometry.lengths import distances

    episode = request.episode
    robot = [body for body in episode.header.bodies if body.kind in ("robot", "gripper")]
    fixed = [body for body in robot if not body.movable]
    if not robot:
        return request.unknown("the trace has no robot")
    com = request.facts.com_position(request.bodies[0])
    names = [body.name for body in fixed or robot]
    apart = [distances(com, episode.tracks[n].position.astype(np.float64), 3) for n in names]
    nearest = request.exact(np.minimum.reduce(apart))
    lost = request.facts.gaps.of_bodies(names, ("position",))
    return nearest if lost is None else hide(nearest, lost)
