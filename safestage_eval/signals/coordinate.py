"""Where a body is along one axis of the world, to compute paths and jerks from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval

from .displacement import POINT

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

AXIS = Option("axis", "choice", "An axis of the world.", required=True, choices=("x", "y", "z"))


@signal(
    "coordinate", "length", args=("a",), needs=("poses",), since=True, options=(AXIS, POINT),
    reads="com",
)  # fmt: skip
def coordinate(request: Request) -> Interval:
    """World coordinate of the centre of mass along an axis.

    m, world; with a reference that is an event, the change since then.
    """
    place = request.place
    along = "xyz".index(str(request.option("axis")))
    if request.since is None or request.since.since is None:
        return request.exact(place[:, along])
    reference = request.reference
    there = reference.of(place, reference.baseline.position(place))
    return request.exact(place[:, along] - there[:, along], reference.baseline.notes)
