"""How high a body is: its centre of mass, and the ends of its geometry."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval

from .displacement import POINT

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request


LIFTED = Option(
    "point",
    "choice",
    "The point of the body that is looked at: the lowest of its geometry, its center of mass, or the "
    "origin of its frame.",
    choices=("lowest", "center", "origin"),
    reads=(("center", "com"), ("origin", "origin")),
)


@signal(
    "height", "length", args=("a",), needs=("poses",), since=True, options=(POINT,), reads="com"
)
def height(request: Request) -> Interval:
    """World z of the centre of mass.

    m, world; with a reference that is an event, the change since then.
    """
    place = request.place
    if request.since is None or request.since.since is None:
        return request.exact(place[:, 2])
    reference = request.reference
    initial = reference.baseline.position(place)
    return request.exact(place[:, 2] - reference.of(place, initial)[:, 2], reference.baseline.notes)


@signal(
    "lift", "length", args=("a",), needs=("poses", "geometry"), since=True, from_start=True,
    options=(LIFTED,),
)  # fmt: skip
def lift(request: Request) -> Interval:
    """Lowest point of the body's geometry above its lowest point at the reference."""
    if request.option("point") in (None, "lowest"):
        movers = request.shapes()
        if isinstance(movers, Interval):
            return movers
        low = request.facts.movers.lowest(request.groups[0][0])
    else:
        low = request.place[:, 2]
    low = np.broadcast_to(low, len(request.episode))
    reference = request.reference
    initial = np.median(low[reference.baseline.stretch], keepdims=True)
    change = low - reference.of(low[:, None], initial)[:, 0]
    return request.exact(change, reference.baseline.notes)


@signal(
    "height_above", "length", args=("a", "b"), needs=("poses", "geometry"),
    groups=True,
)  # fmt: skip
def height_above(request: Request) -> Interval:
    """Lowest point of the first above the highest point of the second."""
    movers = request.shapes()
    if isinstance(movers, Interval):
        return movers
    known = request.facts.movers
    lows = [known.lowest(mover.shape.name) for mover in movers[0]]
    highs = [known.highest(mover.shape.name) for mover in movers[1]]
    value = reduce(np.minimum, lows) - reduce(np.maximum, highs)
    return request.least(request.exact(np.broadcast_to(value, len(request.episode))))
