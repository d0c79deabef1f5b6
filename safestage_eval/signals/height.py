"""How high a body is: its centre of mass, and the ends of its geometry."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.series import Series

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request


@signal("height", "length", args=("a",), needs=("poses",), since=True, reads="com")
def height(request: Request) -> Series:
    """World z of the centre of mass.

    m, world; with a reference that is an event, the change since then.
    """
    com = request.facts.com_position(request.bodies[0])
    if request.since is None or request.since.since is None:
        return request.exact(com[:, 2])
    reference = request.reference
    initial = reference.baseline.position(com)
    return request.exact(com[:, 2] - reference.of(com, initial)[:, 2], reference.baseline.notes)


@signal("lift", "length", args=("a",), needs=("poses", "geometry"), since=True, from_start=True)
def lift(request: Request) -> Series:
    """Lowest point of the body's geometry above its lowest point at the reference."""
    movers = request.shapes()
    if isinstance(movers, Series):
        return movers
    low = np.broadcast_to(request.facts.movers.lowest(request.groups[0][0]), len(request.episode))
    reference = request.reference
    initial = np.median(low[reference.baseline.stretch], keepdims=True)
    change = low - reference.of(low[:, None], initial)[:, 0]
    return request.exact(change, reference.baseline.notes)


@signal(
    "height_above", "length", args=("a", "b"), needs=("poses", "geometry"),
    groups=True, per_frame=True,
)  # fmt: skip
def height_above(request: Request) -> Series:
    """Lowest point of the first above the highest point of the second."""
    movers = request.shapes()
    if isinstance(movers, Series):
        return movers
    known = request.facts.movers
    lows = [known.lowest(mover.shape.name) for mover in movers[0]]
    highs = [known.highest(mover.shape.name) for mover in movers[1]]
    value = reduce(np.minimum, lows) - reduce(np.maximum, highs)
    return request.least(request.exact(np.broadcast_to(value, len(request.episode))))
