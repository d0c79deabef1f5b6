"""By how much a body has turned, and how far it leans."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.episode import Body, Episode
    from safestage_eval.evidence.facts import Request

F64 = NDArray[np.float64]


@signal(
    "turn", "angle", args=("a",), needs=("poses",), since=True, from_start=True, scale=0.0175,
    reads="orientation", metric=True,
)  # fmt: skip
def turn(request: Request) -> Interval:
    """Geodesic angle between the orientation and the one at the reference."""
    from safestage_eval.geometry.pose import angle

    orientation = request.episode.track(request.bodies[0]).orientation
    reference, initial = request.reference, request.reference.baseline.orientation(orientation)
    notes = reference.baseline.notes
    if reference.since is None and not reference.baseline.start:
        return request.exact(angle(orientation, initial), notes)
    return request.exact(angle(orientation, reference.of(orientation, initial)), notes)


def _lean(episode: Episode, body: str, axis: tuple[float, ...]) -> F64:
    """(T,) rad between the body's up axis and world z.

    atan2 of sine and cosine, so that a small tilt keeps its digits (arccos loses half of them).
    """
    from safestage_eval.geometry.lengths import lengths
    from safestage_eval.geometry.pose import rotate

    up = rotate(episode.track(body).orientation, np.asarray(axis, np.float64))
    return np.asarray(np.arctan2(lengths(up, 2), up[:, 2]))


def _lean_since(request: Request) -> Interval:
    """rad, between world z and what was up in the body at the reference, (T,).

    The same as the angle between world z as the body's frame has it now and as it had it then.
    """
    from safestage_eval.geometry.pose import conjugate, rotate

    orientation, reference = request.episode.track(request.bodies[0]).orientation, request.reference
    initial = reference.baseline.orientation(orientation)
    up = np.array([0.0, 0.0, 1.0])
    now = rotate(conjugate(orientation), up)
    then = rotate(conjugate(reference.of(orientation, initial)), up)
    sine = np.linalg.norm(np.cross(now, then), axis=1)
    leans = np.arctan2(sine, np.einsum("ij,ij->i", now, then))
    return request.exact(leans, reference.baseline.notes)


def _has_no_up_axis(body: Body) -> bool:
    return body.up_axis is None and "up_axis" not in body.untold


@signal(
    "tilt", "angle", args=("a",), needs=("poses",), since=True, scale=0.0175, reads="up axis",
    metric=True, exempt=_has_no_up_axis,
)  # fmt: skip
def tilt(request: Request) -> Interval:
    """Angle between the body's declared up axis and world z; a body without one has none.

    rad, from 0 to π. With a reference that is an event, the angle by which it leans away from how it
    stood then: between world z and the axis of the body that pointed up.
    """
    name = request.bodies[0]
    body = request.episode.bodies[name]
    if request.since is not None and not _has_no_up_axis(body):
        return _lean_since(request)
    if body.up_axis is not None:
        return request.exact(_lean(request.episode, name, body.up_axis))
    if not _has_no_up_axis(body):
        return request.unknown(f"the trace does not tell the up axis of {name}")
    # below every upper limit and above no lower one: skipped
    note = f"{name} has no up axis: its tilt is not judged"
    return request.exact(np.full(len(request.episode), -np.inf), (note,))
