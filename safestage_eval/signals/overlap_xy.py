"""How much of a body's footprint lies over another's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request


@signal(
    "overlap_xy", "ratio", args=("a", "b"), needs=("poses", "geometry"), scale=0.1, support=True,
    costly=True,
)  # fmt: skip
def overlap_xy(request: Request) -> Interval:
    """Share of the first body's footprint that lies over the second's.

    At N frames; 0 for a body without a footprint.
    """
    from safestage_eval.geometry import footprint

    movers, (a, b), at = request.relations.signals.movers, request.bodies, request.at
    for name in (a, b):
        if not movers.of([name]):
            return request.unknown(f"the trace has no shape of {name}")
    share = footprint.overlap_xy(movers[a], movers[b], at)
    share = np.broadcast_to(share, len(request.episode))[at]
    return request.exact(np.where(np.isnan(share), 0.0, share))
