"""By how much a body has turned, and how far it leans."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.series import Series

if TYPE_CHECKING:
    from safestage_eval.episode import Body
    from safestage_eval.evidence.facts import Facts, Request
    from safestage_eval.evidence.reference import Reference

F64 = NDArray[np.float64]


def _stretch_turn(
    facts: Facts, body: str, reference: Reference | None, frames: slice
) -> F64 | None:
    """(N,) rad at some neighbouring frames; None where they look back to different moments."""
    from safestage_eval.geometry.pose import angle

    since = facts.since_frame(body, reference, frames)
    if since is None:
        return None
    orientation = facts.episode.track(body).orientation
    one = orientation[since].astype(np.float64)
    if since < 0:
        one = facts.baseline.orientation(orientation)
    return angle(orientation[frames], one)


@signal(
    "turn", "angle", args=("a",), needs=("poses",), since=True, from_start=True, scale=0.0175,
    reads="orientation", metric=True, stretch=_stretch_turn,
)  # fmt: skip
def turn(request: Request) -> Series:
    """Geodesic angle between the orientation and the one at the reference."""
    from safestage_eval.geometry.pose import angle

    orientation = request.episode.track(request.bodies[0]).orientation
    reference, initial = request.reference, request.reference.baseline.orientation(orientation)
    notes = reference.baseline.notes
    if reference.since is None and not reference.baseline.start:
        return request.exact(angle(orientation, initial), notes)
    return request.exact(angle(orientation, reference.of(orientation, initial)), notes)


def _lean(facts: Facts, body: str, axis: tuple[float, ...], frames: slice) -> F64:
    """(N,) rad between the body's up axis and world z.

    atan2 of sine and cosine, so that a small tilt keeps its digits (arccos loses half of them).
    """
    from safestage_eval.geometry.lengths import lengths
    from safestage_eval.geometry.pose import rotate

    up = rotate(facts.episode.track(body).orientation[frames], np.asarray(axis, np.float64))
    return np.asarray(np.arctan2(lengths(up, 2), up[:, 2]))


def _stretch_tilt(facts: Facts, body: str, _: Reference | None, frames: slice) -> F64 | None:
    """(N,) rad at some neighbouring frames; None for a body without an up axis."""
    axis = facts.episode.bodies[body].up_axis
    return None if axis is None else _lean(facts, body, axis, frames)


def _has_no_up_axis(body: Body) -> bool:
    return body.up_axis is None and "up_axis" not in body.untold


@signal(
    "tilt", "angle", args=("a",), needs=("poses",), scale=0.0175, reads="up axis",
    exempt=_has_no_up_axis, stretch=_stretch_tilt,
)  # fmt: skip
def tilt(request: Request) -> Series:
    """Angle between the body's declared up axis and world z; a body without one has none."""
    name = request.bodies[0]
    body = request.episode.bodies[name]
    if body.up_axis is not None:
        return request.exact(_lean(request.facts, name, body.up_axis, slice(None)))
    if not _has_no_up_axis(body):
        return request.unknown(f"the trace does not tell the up axis of {name}")
    # below every upper limit and above no lower one: skipped
    note = f"{name} has no up axis: its tilt is not judged"
    return request.exact(np.full(len(request.episode), -np.inf), (note,))
