"""The built-in relations: at each frame an interval from 0 (it does not hold) to 1 (it does).

Each is decided in the least and in the greatest world that the recording allows (``worlds``); what
is not known leaves it open by itself.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import RELATIONS, relation
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from .relations import Relations

Bool = NDArray[np.bool_]

GROUPS: dict[str, str] = {
    "robot": "all bodies of kind robot or gripper",
    "gripper": "all bodies of kind gripper",
}
"""Unions of bodies that may be used without declaring a role."""

__all__ = ["GROUPS", "RELATIONS"]


@relation("supports", args=("a", "b"), needs=("touch",))
def supports(relations: Relations, bearer: str, borne: str) -> Interval:
    """The first body (never the robot) bears the second: the vertical part of its total
    force on it, friction included, is upward and at least 10 % of its weight.
    """
    first, second = relations.ids(bearer, borne)
    return relations.ends(lambda world: world.graph.supports(first, second))


@relation("supported", args=("a",), needs=("touch",))
def supported(relations: Relations, name: str) -> Interval:
    """A path of support leads from the body to a fixture."""
    (body,) = relations.ids(name)
    return relations.ends(lambda world: world.graph.supported(body))


@relation("carried", args=("a",), needs=("touch",))
def carried(relations: Relations, name: str) -> Interval:
    """A path of support leads from the body to one that the robot holds.

    Without forces also where fingers hold it and nothing else supports it: friction lifts what
    they squeeze, and no shape shows it.
    """
    (body,) = relations.ids(name)
    return relations.ends(lambda world: world.carried(body))


@relation("depends_on", args=("a", "b"), needs=("touch",), costly=True)
def depends_on(relations: Relations, body: str, on: str, frames: Bool | None = None) -> Interval:
    """The first body would fall if the second were removed (the second may be anything but the
    robot); by statics over the recorded contacts.

    Without forces: it rests on the second, directly or not.
    """
    return relations.falls_without(body, on, frames)


@relation("inside", args=("a", "b"), needs=("poses", "geometry"))
def inside(relations: Relations, name: str, container: str) -> Interval:
    """The first body lies in the second's cavity, seen in the second's own frame.

    Its lowest point is under the rim and within, and its centroid is within or the container supports
    it. False without a declared cavity; unknown for a body without a shape.
    """
    body, vessel = relations.ids(name, container)
    parts = relations.in_cavity(name, container)
    if isinstance(parts, str):
        return relations.unknown(f"the trace has no {parts}")
    low, centroid = parts
    found = relations.ends(lambda world: low & (centroid | world.graph.supports(vessel, body)))
    return relations.where_measured(found, (name, container))


@relation("held", args=("a",), needs=("touch",))
def held(relations: Relations, name: str) -> Interval:
    """Fingers of one gripper press on the body from opposing sides."""
    (body,) = relations.ids(name)
    return relations.ends(lambda world: world.grasped(body))


@relation("leaned_on", args=("a",), needs=("touch",))
def leaned_on(relations: Relations, name: str) -> Interval:
    """The robot, and bodies that it holds or carries, press on the body with at least 10 % of its
    weight, or 0.1 N if that is less; it may be the body that leans on them.
    """
    (body,) = relations.ids(name)
    return relations.ends(lambda world: world.leaned_on(body))


@relation("exposed_to", args=("a", "b"), needs=("touch",), groups=True)
def exposed_to(relations: Relations, name: str, to: str) -> Interval:
    """The first body has touched the second, or what had been exposed to it before."""
    first, second = (relations.ids(*relations.signals.bodies(one)) for one in (name, to))
    frames = np.arange(len(relations.episode))
    return relations.ends(lambda world: frames >= relations.exposure(world).since(first, second))


@relation("caused", args=("a",), needs=("touch",), gate=True)
def caused(relations: Relations, name: str) -> Interval:
    """Since the start the robot has touched the body, or something that touched it from then
    on: what happens to it may be the robot's doing.
    """
    if not relations.robot:
        return relations.unknown("the trace has no poses of the robot")
    frames = np.arange(len(relations.episode))
    (body,) = relations.ids(name)
    found = relations.ends(lambda world: frames >= relations.reached(world, body))
    hand = any(body.kind == "gripper" for body in relations.episode.header.bodies)
    if relations.blind and not hand:
        why = "without contact forces or poses of the robot's hand its touches are not known"
        return replace(found, upper=np.ones(len(frames)), notes=(*found.notes, why))
    return found


@relation("may_be_caused", args=("a",), needs=("touch",), gate=True)
def may_be_caused(relations: Relations, name: str) -> Interval:
    """False while the trace shows that neither the robot, nor anything that it touched, has touched
    the body; true otherwise, and unknown for a body that has moved since the first frame where
    touches are not known.
    """
    found = relations.told("caused", (name,))
    likely = found.upper.astype(bool) & relations.has_lain_still(name)
    lower = np.maximum(found.lower, likely)
    notes = found.notes if (lower < found.upper).any() else ()
    return Interval(lower, found.upper, "number", notes)
