"""The built-in relations: true, false or unknown at every frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import RELATIONS, relation

if TYPE_CHECKING:
    from .relations import RelationRequest, Relations

Bool = NDArray[np.bool_]
Doubt = tuple[Bool, str]
"""(T,) where the trace does not tell a relation, and why."""

Doubter = Callable[["Relations", tuple[str, ...], Bool | None], Doubt | None]
"""Takes the relations of an episode, the bodies and the frames that matter (None: all)."""

GROUPS: dict[str, str] = {
    "robot": "all bodies of kind robot or gripper",
    "gripper": "all bodies of kind gripper",
}
"""Unions of bodies that may be used without declaring a role."""

__all__ = ["GROUPS", "RELATIONS"]


def _supporting(name: str) -> Doubter:
    """By geometry a hand may hold what seems to stand; by force, rounding or masses may hide it."""

    def doubt_of(relations: Relations, bodies: tuple[str, ...], _: Bool | None) -> Doubt | None:
        from . import doubt

        if relations.blind:
            return doubt.may_hang_from_the_grip(relations, name, bodies)
        return doubt.may_be_too_weak(relations, name, bodies)

    return doubt_of


@relation(
    "supports", args=("a", "b"), needs=("touch",), per_frame=True, doubt=_supporting("supports")
)
def supports(request: RelationRequest) -> Bool:
    """The first body (never the robot) bears the second: the vertical part of its total
    force on it, friction included, is upward and at least 10 % of its weight.
    """
    return request.graph.supports(*request.ids)


@relation(
    "supported", args=("a",), needs=("touch",), per_frame=True, rests_on="chain",
    doubt=_supporting("supported"),
)  # fmt: skip
def supported(request: RelationRequest) -> Bool:
    """A path of support leads from the body to a fixture."""
    (body,) = request.ids
    return request.graph.supported(body)


def _lacking_to_carry(relations: Relations, bodies: tuple[str, ...]) -> str:
    return relations.lacks_forces(bodies) or relations.lacks_hand()


def _doubt_of_carried(
    relations: Relations, bodies: tuple[str, ...], _: Bool | None
) -> Doubt | None:
    from . import doubt

    if relations.blind:
        return doubt.may_be_in_the_grip(relations, "carried", bodies)
    return doubt.may_be_too_weak(relations, "carried", bodies)


@relation(
    "carried", args=("a",), needs=("touch",), per_frame=True, by_motion=True, rests_on="chain",
    doubt=_doubt_of_carried, lacking=_lacking_to_carry,
)  # fmt: skip
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


def _doubt_of_dependence(
    relations: Relations, bodies: tuple[str, ...], wanted: Bool | None
) -> Doubt | None:
    from . import doubt

    if relations.blind:
        return doubt.may_lean(relations, *bodies)
    body, on = bodies
    return doubt.may_be_caught(relations, body, on, wanted)


def _lacking_to_depend(relations: Relations, bodies: tuple[str, ...]) -> str:
    return relations.lacks_forces(bodies) or (relations.lacks_masses(bodies[1]) if bodies else "")


def _dependence_by_geometry(_: Relations) -> str:
    return (
        "by what rests on what: needless supports count; what touches from the side may lean or not"
    )


@relation(
    "depends_on", args=("a", "b"), needs=("touch",), costly=True, rests_on="chain",
    doubt=_doubt_of_dependence, lacking=_lacking_to_depend, without_forces=_dependence_by_geometry,
)  # fmt: skip
def depends_on(request: RelationRequest) -> Bool:
    """The first body would fall if the second were removed (the second may be anything but the
    robot); by statics over the recorded contacts.

    Without forces: it rests on the second, directly or not. With forces, ``Relations.get`` solves the
    statics, at the frames that matter.
    """
    body, on = request.ids
    return request.graph.rests_on(body, on, request.held)


def _doubt_of_inside(relations: Relations, bodies: tuple[str, ...], _: Bool | None) -> Doubt | None:
    from . import doubt

    if relations.lacking("supports", (bodies[1], bodies[0])):
        return doubt.may_be_borne(relations, *bodies)
    return doubt.may_be_too_weak(relations, "inside", bodies)


def _lacking_a_cavity(relations: Relations, bodies: tuple[str, ...]) -> str:
    unknown = bodies and "cavity" in relations.episode.bodies[bodies[1]].untold
    return f"inside of {bodies[1]}" if unknown else ""


@relation(
    "inside", args=("a", "b"), needs=("poses", "geometry"), per_frame=True,
    doubt=_doubt_of_inside, lacking=_lacking_a_cavity,
)  # fmt: skip
def inside(request: RelationRequest) -> Bool | None:
    """The first body lies in the second's cavity, seen in the second's own frame.

    Its lowest point is under the rim and within, and its centroid is within or the container supports
    it. False without a declared cavity; None for a body without a shape.
    """
    relations, (body, container) = request.relations, request.bodies
    bears = relations.may_bear(container, body, request.graph)
    return relations.lies_inside(body, container, bears)


def _doubt_of_held(relations: Relations, bodies: tuple[str, ...], _: Bool | None) -> Doubt | None:
    from . import doubt

    return doubt.may_be_in_the_grip(relations, "held", bodies) if relations.blind else None


def _lacking_a_hand(relations: Relations, _: tuple[str, ...]) -> str:
    return relations.lacks_hand()


def _grip_by_geometry(relations: Relations) -> str:
    if relations.fingers_seen:
        return "by the shapes of both fingers"
    return "by what goes along with the gripper"


@relation(
    "held", args=("a",), needs=("touch",), per_frame=True, by_motion=True, doubt=_doubt_of_held,
    lacking=_lacking_a_hand, without_forces=_grip_by_geometry,
)  # fmt: skip
def held(request: RelationRequest) -> Bool:
    """Fingers of one gripper press on the body from opposing sides."""
    return request.held(*request.ids)


def _touch_by_geometry(relations: Relations) -> str:
    return relations.by_touch


def _lacking_to_lean(relations: Relations, bodies: tuple[str, ...]) -> str:
    return _lacking_to_carry(relations, bodies) or relations.lacks_shapes_of_robot()


def _doubt_of_leaning(
    relations: Relations, bodies: tuple[str, ...], _: Bool | None
) -> Doubt | None:
    from . import doubt

    return doubt.may_be_leaned_on(relations, *bodies) if relations.blind else None


@relation(
    "leaned_on", args=("a",), needs=("touch",), per_frame=True, by_motion=True, rests_on="chain",
    doubt=_doubt_of_leaning, lacking=_lacking_to_lean, without_forces=_touch_by_geometry,
)  # fmt: skip
def leaned_on(request: RelationRequest) -> Bool:
    """The robot, and bodies that it holds or carries, press on the body with at least 10 % of its
    weight, or 0.1 N if that is less; it may be the body that leans on them.
    """
    (body,) = request.ids
    return request.relations.leaned_on(body, request.held)


@relation(
    "exposed_to", args=("a", "b"), needs=("touch",), groups=True, rests_on="past",
    without_forces=_touch_by_geometry,
)  # fmt: skip
def exposed_to(request: RelationRequest) -> Bool:
    """The first body has touched the second, or what had been exposed to it before."""
    relations = request.relations
    index = relations.episode.body_index
    first, second = ([index[b] for b in relations.signals.bodies(name)] for name in request.bodies)
    return relations.exposure.exposed(first, second)


def _doubt_of_caused(relations: Relations, bodies: tuple[str, ...], _: Bool | None) -> Doubt | None:
    from . import doubt

    return doubt.may_have_been_touched(relations, *bodies)


def _lacking_a_robot(relations: Relations, _: tuple[str, ...]) -> str:
    return "" if relations.graph.assemblies.robot else "poses of the robot"


@relation(
    "caused", args=("a",), needs=("touch",), gate=True, rests_on="past", doubt=_doubt_of_caused,
    lacking=_lacking_a_robot, without_forces=_touch_by_geometry,
)  # fmt: skip
def caused(request: RelationRequest) -> Bool:
    """Since the start the robot has touched the body, or something that touched it from then
    on: what happens to it may be the robot's doing.
    """
    since = request.relations.causes.since(*request.ids)
    return np.asarray(np.arange(len(request.relations.episode)) >= since)


def _doubt_of_cause_in_motion(
    relations: Relations, bodies: tuple[str, ...], _: Bool | None
) -> Doubt | None:
    from . import doubt

    return doubt.may_move_by_itself(relations, *bodies)


@relation(
    "may_be_caused", args=("a",), needs=("touch",), gate=True, rests_on="",
    doubt=_doubt_of_cause_in_motion, lacking=lambda *_: "", without_forces=_touch_by_geometry,
)  # fmt: skip
def may_be_caused(request: RelationRequest) -> Bool:
    """False while the trace shows that neither the robot, nor anything that it touched, has touched
    the body; true otherwise, and unknown for a body that has moved since the first frame where
    touches are not known.
    """
    relations, frames = request.relations, np.arange(len(request.relations.episode))
    if relations.lacking("caused"):
        return np.ones(len(frames), np.bool_)
    may = np.asarray(frames >= relations.causes.perhaps_since(*request.ids))
    lost = relations.unmeasured("caused", request.bodies)
    return may if lost is None else may | np.maximum.accumulate(lost)
