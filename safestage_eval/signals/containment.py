"""How deep a body is inside something: the cavity of a container, or a box in the world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

BOX = Option(
    "box",
    "box",
    'Two opposite corners: [["-0.5 m", "-1 m", "0 m"], ["1 m", "1 m", "1.5 m"]].',
    required=True,
)


@signal("containment_depth", "length", args=("a", "b"), needs=("poses", "geometry"))
def containment_depth(request: Request) -> Interval:
    """Signed depth of the first body's hull centroid in the second's cavity."""
    from safestage_eval.geometry import cavity

    movers = request.shapes()
    if isinstance(movers, Interval):
        return movers
    container = request.bodies[1]
    hollow = request.episode.bodies[container].cavity
    if hollow is None:
        return request.unknown(f"{container} has no declared cavity")
    depth = cavity.containment_depth(movers[0][0], movers[1][0], hollow)
    return request.exact(np.broadcast_to(depth, len(request.episode)))


@signal(
    "workspace_margin", "length", args=("a",), needs=("poses", "geometry"), groups=True,
    options=(BOX,),
)  # fmt: skip
def workspace_margin(request: Request) -> Interval:
    """Signed distance from the body to the faces of a box, inside positive.

    m, of all geometry to the nearest face; negative: how far it is beyond one.
    """
    from safestage_eval.geometry.extent import reach

    movers = request.shapes()
    if isinstance(movers, Interval):
        return movers
    box = np.asarray(request.option("box"), np.float64)
    if box.shape != (6,):
        return request.unknown("no box is declared")
    room = np.full(len(request.episode), np.inf)
    for mover in movers[0]:
        for axis, (low, high) in enumerate(zip(box[:3], box[3:], strict=True)):
            ahead = np.eye(3)[axis]
            room = np.minimum(room, high - reach(mover, ahead))
            room = np.minimum(room, -reach(mover, -ahead) - low)
    return request.least(request.exact(room))
