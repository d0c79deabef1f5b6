"""How firmly a body stands on its support, and how much of its load each support carries."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.series import Series

if TYPE_CHECKING:
    from safestage_eval.relations.relations import SupportRequest


@signal(
    "support_margin", "length", args=("a",), needs=("forces", "masses"), reads="", support=True,
    costly=True,
)  # fmt: skip
def support_margin(request: SupportRequest) -> Series:
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
    return Series(lower, standing.most, request.signal.dimension, standing.notes)


@signal(
    "tipping_angle", "angle", args=("a",), needs=("forces", "masses"), scale=0.0175, reads="",
    support=True, costly=True,
)  # fmt: skip
def tipping_angle(request: SupportRequest) -> Series:
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
    return Series(lower, upper, request.signal.dimension, standing.notes)


@signal("load_share", "ratio", args=("a", "b"), needs=("touch",), scale=0.1, reads="", support=True)
def load_share(request: SupportRequest) -> Series:
    """Share of all upward force on the first body that the second exerts.

    Without forces: 1 where nothing else can support it, a range where something else may.
    """
    relations, (body, support), frames = request.relations, request.bodies, len(request.episode)
    index = request.episode.body_index
    if not relations.blind:
        return relations.loads.share(index[body], index[support])
    if relations.lacking("supports", (support, body)):
        return request.unknown("the trace has no contact forces")
    bearers = relations.graph.bearers(index[body])
    mine = bearers.get(index[support], np.zeros(frames, np.bool_))
    others = [bears for other, bears in bearers.items() if other != index[support]]
    in_hand = relations.may_be_held(index[body]) | relations.graph.borne_by_robot(index[body])
    shared = np.logical_or.reduce([in_hand, *others])
    lower, upper = np.where(mine & ~shared, 1.0, 0.0), np.where(mine, 1.0, 0.0)
    return Series(lower, upper, request.signal.dimension, relations.caveat("supports"))
