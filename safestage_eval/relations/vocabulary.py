"""The built-in relations: true, false or unknown at every frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import RELATIONS, relation

if TYPE_CHECKING:
    from .graph import SupportGraph
    from .measure import Relations

Bool = NDArray[np.bool_]

GROUPS: dict[str, str] = {
    "robot": "all bodies of kind robot or gripper",
    "gripper": "all bodies of kind gripper",
}
"""Unions of bodies that may be used without declaring a role."""

__all__ = ["GROUPS", "RELATIONS", "RelationRequest"]


class RelationRequest(NamedTuple):
    """One relation to be decided.

    Attributes:
        relations: of the episode.
        bodies: names of bodies or unions, in the relation's order.
        graph: who supports whom.
        held: index of a body → (T,) it is held.
    """

    relations: Relations
    bodies: tuple[str, ...]
    graph: SupportGraph
    held: Callable[[int], Bool]

    @property
    def ids(self) -> list[int]:
        """The bodies' indices."""
        return [self.relations.episode.body_index[body] for body in self.bodies]


@relation("supports", args=("a", "b"), needs=("touch",), per_frame=True)
def supports(request: RelationRequest) -> Bool:
    """The first body (never the robot) bears the second: the vertical part of its total
    force on it, friction included, is upward and at least 10 % of its weight.
    """
    return request.graph.supports(*request.ids)


@relation("supported", args=("a",), needs=("touch",), per_frame=True, rests_on="chain")
def supported(request: RelationRequest) -> Bool:
    """A path of support leads from the body to a fixture."""
    (body,) = request.ids
    return request.graph.supported(body)


@relation(
    "carried", args=("a",), needs=("touch",), per_frame=True, by_motion=True, rests_on="chain"
)
def carried(request: RelationRequest) -> Bool:
    """A path of support leads from the body to one that the robot holds.

    Without forces also where fingers hold it and nothing else supports it: friction lifts what
    they squeeze, and no shape shows it.
    """
    (body,) = request.ids
    carried = request.graph.carried(body, request.held)
    if request.relations.blind:
        carried = carried | (request.held(body) & ~request.relations.borne(body))
    return carried


@relation("depends_on", args=("a", "b"), needs=("touch",), costly=True, rests_on="chain")
def depends_on(request: RelationRequest) -> Bool:
    """Take the second body, whatever it is but the robot, away and the first falls (statics
    over the recorded contacts).

    Without forces: it rests on the second, directly or not. With forces, ``Relations.get`` solves the
    statics, at the frames that matter.
    """
    body, on = request.ids
    return request.graph.rests_on(body, on, request.held)


@relation("inside", args=("a", "b"), needs=("poses", "geometry"), per_frame=True)
def inside(request: RelationRequest) -> Bool | None:
    """The first body lies in the second's cavity, seen in the second's own frame.

    Its lowest point is under the rim and within, and its centroid is within or the container supports
    it. False without a declared cavity; None for a body without a shape.
    """
    relations, (body, container) = request.relations, request.bodies
    bears = relations.may_bear(container, body, request.graph)
    return lies_inside(relations, body, container, bears)


def lies_inside(relations: Relations, body: str, container: str, bears: Bool) -> Bool | None:
    """(T,) as ``inside``, where the container ``bears`` (T,) the body or may do so."""
    from safestage_eval.geometry.cavity import inside_parts

    frames, movers = len(relations.episode), relations.signals.movers
    cavity = relations.episode.bodies[container].cavity
    if cavity is None:
        return np.zeros(frames, np.bool_)
    if not movers.of([body]):
        return None
    low, centroid = inside_parts(movers[body], movers[container], cavity)
    return np.broadcast_to(low & (centroid | bears), frames)


@relation("held", args=("a",), needs=("touch",), per_frame=True, by_motion=True)
def held(request: RelationRequest) -> Bool:
    """Fingers of one gripper press on the body from opposing sides."""
    return request.held(*request.ids)


@relation("exposed_to", args=("a", "b"), needs=("touch",), groups=True, rests_on="past")
def exposed_to(request: RelationRequest) -> Bool:
    """The first body has touched the second, or what had been exposed to it before."""
    relations = request.relations
    index = relations.episode.body_index
    first, second = ([index[b] for b in relations.signals.bodies(name)] for name in request.bodies)
    return relations.exposure.exposed(first, second)


@relation("caused", args=("a",), needs=("touch",), gate=True, rests_on="past")
def caused(request: RelationRequest) -> Bool:
    """Since the start the robot has touched the body, or something that touched it from then
    on: what happens to it may be the robot's doing.
    """
    since = request.relations.causes.since(*request.ids)
    return np.asarray(np.arange(len(request.relations.episode)) >= since)
