"""The names of the built-in relations: true, false or unknown at every frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RelationSpec:
    """What the rule checker and the documentation know about one relation.

    Attributes:
        name: as written in rules.
        args: number of arguments.
        meaning: one sentence.
        needs: what the trace must hold; touch: contact forces or, less well, geometry.
        groups: ``robot`` and ``gripper`` are allowed as arguments.
    """

    name: str
    args: int
    meaning: str
    needs: tuple[str, ...]
    groups: bool = False


RELATIONS: dict[str, RelationSpec] = {
    spec.name: spec
    for spec in (
        RelationSpec(
            "supports",
            2,
            "The first body (never the robot) bears the second: the vertical part of its total "
            "force on it, friction included, is upward and at least 10 % of its weight.",
            ("touch",),
        ),
        RelationSpec(
            "supported", 1, "A path of support leads from the body to a fixture.", ("touch",)
        ),
        RelationSpec(
            "carried",
            1,
            "A path of support leads from the body to one that the robot holds.",
            ("touch",),
        ),
        RelationSpec(
            "depends_on",
            2,
            "Take the second body, whatever it is but the robot, away and the first falls (statics "
            "over the recorded contacts).",
            ("touch",),
        ),
        RelationSpec(
            "inside",
            2,
            "The first body lies in the second's cavity, seen in the second's own frame.",
            ("poses", "geometry"),
        ),
        RelationSpec(
            "held",
            1,
            "Fingers of one gripper press on the body from opposing sides.",
            ("touch",),
        ),
        RelationSpec(
            "exposed_to",
            2,
            "The first body has touched the second, or what had been exposed to it before.",
            ("touch",),
            groups=True,
        ),
        RelationSpec(
            "caused",
            1,
            "Since the start the robot has touched the body, or something that touched it from then "
            "on: what happens to it may be the robot's doing.",
            ("touch",),
        ),
    )
}
"""Every built-in relation, by name."""

GATES = ("caused",)
"""Relations that say whether something else counts at all: they take no part in how close it came."""

GROUPS: dict[str, str] = {
    "robot": "all bodies of kind robot or gripper",
    "gripper": "all bodies of kind gripper",
}
"""Unions of bodies that may be used without declaring a role."""
