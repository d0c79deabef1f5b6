"""How far geometries are apart: of two bodies, of their projections, of the robot's own bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request
    from safestage_eval.geometry.mover import Mover


@signal(
    "clearance", "length", args=("a", "b"), needs=("poses", "geometry"), groups=True,
    symmetric=True, capped=True,
)  # fmt: skip
def clearance(request: Request) -> Interval:
    """Distance between the two geometries; zero or less when they touch or penetrate.

    m, least over the pairs of two unions; exact up to the cap.
    """
    return _clearance(request, flat=False)


@signal(
    "clearance_xy", "length", args=("a", "b"), needs=("poses", "geometry"), groups=True,
    symmetric=True, capped=True,
)  # fmt: skip
def clearance_xy(request: Request) -> Interval:
    """Distance between the horizontal projections; zero or less when they overlap.

    m, least over the pairs of two unions; exact up to the cap.
    """
    return _clearance(request, flat=True)


def _clearance(request: Request, *, flat: bool) -> Interval:
    from safestage_eval.geometry.group_clearance import clearance_series

    movers = request.shapes()
    if isinstance(movers, Interval):
        return movers
    distance = clearance_series(
        movers[0],
        movers[1],
        request.cap,
        flat=flat,
        slack=request.slack,
        deep=request.deep,
    )
    frames = len(request.episode)
    lower, upper = (
        x if len(x) == frames else np.broadcast_to(x, frames)
        for x in (distance.lower, distance.upper)
    )
    return request.least(Interval(lower, upper, request.dimension))


@signal(
    "self_clearance", "length", args=(), needs=("poses", "geometry"), reads="robot",
    capped=True,
)  # fmt: skip
def self_clearance(request: Request) -> Interval:
    """Least distance between bodies of the robot that the model lets collide.

    m; exact up to the cap.
    """
    from safestage_eval.evidence.facts import colliding_pairs, open_below
    from safestage_eval.geometry.group_clearance import clearance_pairs

    pairs = request.facts.pairs_between(())
    if not pairs:
        return request.unknown("the trace has no two bodies of a robot that may collide")
    # the nearest pairs first: what is farther off than they are need not be known exactly
    distance = clearance_pairs(
        sorted(pairs, key=_gap_at_start),
        len(request.episode),
        request.cap,
        slack=request.slack,
        deep=request.deep,
    )
    unseen = {
        body.name for pair in colliding_pairs(request.episode) for body in pair if body.unseen
    }
    return open_below(Interval(distance.lower, distance.upper, request.dimension), sorted(unseen))


def _gap_at_start(pair: tuple[Mover, Mover]) -> float:
    """m, distance of two shapes in the first frame."""
    from safestage_eval.geometry.group_clearance import clearance_pairs
    from safestage_eval.geometry.mover import Mover

    a, b = (Mover.build(m.shape, m.position[0], m.orientation[0]) for m in pair)
    return float(clearance_pairs([(a, b)], 1).lower[0])
