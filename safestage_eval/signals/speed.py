"""How fast bodies move and turn, from recorded velocities or, where there are none, from poses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

F64 = NDArray[np.float64]

OVER = Option(
    "over",
    "time",
    "How far it went or turned within so long before, per time, from its poses; the recorded velocity "
    "if left out.",
    param=True,
    looks="back",
    reads="com",
)


@signal(
    "speed", "speed", args=("a",), needs=("twists",), options=(OVER,), reads="velocity", ahead=True
)
def speed(request: Request) -> Interval:
    """Speed of the centre of mass.

    m/s. With ``over``: how far it went within that time before each frame, per time. The first frame,
    before which nothing is known, has the recorded speed.
    """
    from safestage_eval.evidence.motion import before
    from safestage_eval.geometry.lengths import distances, lengths

    name = request.bodies[0]
    velocity, notes = request.facts.com_velocity(name)
    value = lengths(velocity)
    if request.over is None or len(value) < 2:
        return request.exact(value, notes)
    t, com = request.episode.t, request.facts.com_position(name)
    first = before(t, request.over)
    return _mean(request, value, distances(com, com[first], 3), t - t[first])


def _mean(request: Request, value: F64, gone: F64, seconds: F64) -> Interval:
    """How far it went (T,) per time (T,), but in the first frame, of which ``value`` (T,) tells.

    Where samples are far apart, it may have gone all of that within the time that is asked for.
    """
    value[1:] = gone[1:] / seconds[1:]
    coarse, over = request.episode.clock.coarse, request.over or 0.0
    brief = coarse & (seconds > over * (1 + 1e-6))
    brief[0] = False
    if not brief.any():
        return request.exact(value)
    most = np.where(brief, gone / over, value)
    return Interval(value, most, request.dimension)


@signal(
    "vertical_speed", "speed", args=("a",), needs=("twists",), reads="velocity", ahead=True
)  # fmt: skip
def vertical_speed(request: Request) -> Interval:
    """Upward speed of the centre of mass; negative when it falls."""
    velocity, notes = request.facts.com_velocity(request.bodies[0])
    return request.exact(velocity[:, 2], notes)


@signal(
    "angular_speed", "rate", args=("a",), needs=("twists",), scale=0.1,
    options=(replace(OVER, reads="orientation"),), reads="angular velocity", ahead=True,
)  # fmt: skip
def angular_speed(request: Request) -> Interval:
    """Angular speed.

    rad/s. With ``over``: the angle by which it turned within that time before each frame, per time.
    The recorded angular velocity of what rests on two edges may jitter while it turns nowhere. The
    first frame, before which nothing is known, has the recorded rate.
    """
    from safestage_eval.evidence.motion import before
    from safestage_eval.geometry.lengths import lengths
    from safestage_eval.geometry.pose import angle

    name = request.bodies[0]
    velocity, notes = request.facts.angular_velocity(name)
    value = lengths(velocity)
    if request.over is None or len(value) < 2:
        return request.exact(value, notes)
    t, orientation = request.episode.t, request.episode.track(name).orientation
    first = before(t, request.over)
    return _mean(request, value, angle(orientation, orientation[first]), t - t[first])


@signal(
    "relative_speed", "speed", args=("a", "b"), needs=("twists",), groups=True, reads="velocity",
    ahead=True, symmetric=True,
)  # fmt: skip
def relative_speed(request: Request) -> Interval:
    """Speed of one centre of mass relative to the other; for a union, of its fastest body."""
    from safestage_eval.geometry.lengths import distances

    first, second = (
        [request.facts.com_velocity(name) for name in group] for group in request.groups
    )
    pairs = [distances(a, b) for a, _ in first for b, _ in second]
    notes = tuple(dict.fromkeys(note for _, notes in first + second for note in notes))
    return request.exact(np.maximum.reduce(pairs), notes)
