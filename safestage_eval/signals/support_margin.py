"""How firmly a body stands on its support, and how much of its load each support carries."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request
    from safestage_eval.relations.relations import Relations
    from safestage_eval.relations.worlds import World

Bool = NDArray[np.bool_]


@signal(
    "support_margin", "length", args=("a",), needs=("forces", "masses"), reads="", support=True,
    costly=True,
)  # fmt: skip
def support_margin(request: Request) -> Interval:
    """Signed distance of the projected centre of mass of the body and everything that rests on
    it from the edge of the polygon of its support contacts; positive when it stands firm.

    m, at N frames; −∞ where nothing supports it.
    """
    relations = request.relations
    if relations.blind:
        return request.unknown("the trace has no contact forces")
    index = request.episode.body_index[request.bodies[0]]
    standing = relations.loads.standing(index, request.at)
    lower = np.where(np.isnan(standing.margin), -np.inf, standing.margin)
    return Interval(lower, standing.most, request.signal.dimension, standing.notes)


@signal(
    "tipping_angle", "angle", args=("a",), needs=("forces", "masses"), scale=0.0175, reads="",
    support=True, costly=True,
)  # fmt: skip
def tipping_angle(request: Request) -> Interval:
    """Angle whose tangent is the support margin over the height of that centre of mass above
    the support: by how much it may be tilted before it topples.

    rad, at N frames; unknown where nothing supports it.
    """
    relations = request.relations
    if relations.blind:
        return request.unknown("the trace has no contact forces")
    index = request.episode.body_index[request.bodies[0]]
    standing = relations.loads.standing(index, request.at)
    tilt, most = (np.arctan2(m, standing.height) for m in (standing.margin, standing.spanned))
    nothing = np.isnan(tilt)
    lower = np.where(nothing, -np.inf, tilt)
    upper = np.where(nothing | np.isinf(standing.spanned), np.inf, most)
    return Interval(lower, upper, request.signal.dimension, standing.notes)


@signal("load_share", "ratio", args=("a", "b"), needs=("touch",), scale=0.1, reads="", support=True)
def load_share(request: Request) -> Interval:
    """Share of all upward force on the first body that the second exerts.

    Without forces: 1 where nothing else can support it, a range where something else may.
    """
    relations: Relations = request.relations
    body, support = request.bodies
    index = request.episode.body_index
    if not relations.blind:
        return relations.loads.share(index[body], index[support])
    borne, by = index[body], index[support]

    def alone(by_all: World, by_it: World) -> Bool:
        """(T,) it bears the body, and nothing else and no hand does."""
        bearers = by_all.graph.bearers(borne)
        others = [bears for other, bears in bearers.items() if other != by]
        in_hand = by_all.held(borne) | by_all.graph.borne_by_robot(borne)
        shared: Bool = np.logical_or.reduce([in_hand, *others])
        return by_it.graph.supports(by, borne) & ~shared

    lower = np.where(alone(relations.most, relations.least), 1.0, 0.0)
    upper = np.where(relations.most.graph.supports(by, borne), 1.0, 0.0)
    return Interval(lower, upper, request.signal.dimension, relations.caveat("supports"))
