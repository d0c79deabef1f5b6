"""Checks of what is said once about bodies and joints: shapes, masses, fingers, limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safestage_eval._text.plural import first_few
from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import also, check
from safestage_eval.episode import Body
from safestage_eval.episode.invariants import all_finite
from safestage_eval.episode.scene_shapes import body_shapes

from .gravity_checks import BORNE, borne_shares

LARGE, SMALL = 5.0, 5e-4
"""m; radius of the ball around an object that a robot arm has to do with."""


@also("AUD131")
def handled_sizes(subject: Subject) -> Iterator[Defect]:
    """Compares shapes with what a robot arm handles."""
    if subject.diagnosis.repair is not None or not subject.readable:
        return
    for body in subject.objects:
        shapes = body_shapes(body, subject.episode.meshes)
        if shapes is not None and not SMALL <= shapes.radius <= LARGE:
            if any(body.name in error.bodies for error in subject.diagnosis.left):
                continue
            yield Defect(
                f"{body.name!r} has a radius of {shapes.radius:.3g} m.",
                "write sizes of geoms in metres: half sides of a box, radius and half length",
                "sizes are in mm or cm" if shapes.radius > LARGE else "sizes were scaled twice",
                bodies=(body.name,),
                field="bodies.geoms",
            )


@check(
    "AUD132",
    "error",
    title="a mass is not in kilograms",
    why="Support is decided from weights, and impacts and forces are compared with them.",
    example="mass = 250 (grams)",
    unless=("AUD101",),
)
def masses(subject: Subject) -> Iterator[Defect]:
    """Compares masses with volumes and with the forces that bear them."""
    yield from subject.explained("AUD132")
    if not subject.sound:
        return
    shares = borne_shares(subject)
    off = {name: share for name, share in shares.items() if abs(share - 1) > BORNE}
    for name, share in off.items() if 2 * len(off) <= len(shares) else ():
        mass = subject.episode.bodies[name].mass or 0.0
        yield Defect(
            f"{name!r} has a mass of {mass:.3g} kg, but at rest it is borne by what {share * mass:.3g} kg "
            "weigh.",
            f"write the mass of the simulation: about {share * mass:.3g} kg",
            "the header has another model's mass, or a support is not recorded",
            bodies=(name,),
            field="bodies.mass",
            severity="warning",
        )


@check(
    "AUD135",
    "warning",
    title="bodies without shapes",
    why="No clearance, support or edge of a body without a shape is known; what it may have touched "
    "neither.",
    example="an importer that was given no meshes",
)
def no_shapes(subject: Subject) -> Iterator[Defect]:
    """Looks for objects, fixtures and hands without geoms; a mere frame has mass 0."""
    bare = [b.name for b in subject.header.bodies if b.unseen and b.kind in _SHAPED]
    if bare:
        yield Defect(
            f"{first_few([*map(repr, bare)], 4)} {'have' if len(bare) > 1 else 'has'} no shape.",
            "add collision shapes (geoms), by a map file where they are imported; mass = 0 for mere frames",
            bodies=tuple(bare),
            field="bodies.geoms",
        )


_SHAPED = ("object", "fixture", "gripper")


@check(
    "AUD136",
    "warning",
    title="fingers or tool centre point are not declared",
    why="Held, carried and released are decided from the two fingers; without them grips are guessed from "
    "motion, or unknown.",
    example="a gripper whose bodies have no finger = left and right",
)
def no_fingers(subject: Subject) -> Iterator[Defect]:
    """Looks for bodies with finger = left and right, and for one with a tool centre point."""
    robot = [b for b in subject.header.bodies if b.kind in ("robot", "gripper")]
    moving = [b for b in robot if b.movable]
    if not moving:
        return
    sides = {body.finger for body in robot} - {None}
    lacking = [f"no body with finger = {side}" for side in ("left", "right") if side not in sides]
    lacking += [] if any(body.tcp for body in robot) else ["no body with a tcp"]
    if lacking:
        yield Defect(
            f"the robot has {' and '.join(lacking)}.",
            "set finger = left or right on the bodies that close on an object, and tcp on the hand",
            field="bodies.finger" if len(sides) < 2 else "bodies.tcp",
            severity=None if len(sides) < 2 else "note",
        )


@check(
    "AUD137",
    "warning",
    title="objects without a mass",
    why="Without weights, support and the strength of an impact are unknown.",
    example="an importer that was given no masses",
)
def no_masses(subject: Subject) -> Iterator[Defect]:
    """Looks for movable objects whose mass is unknown."""
    bare = [body.name for body in subject.objects if body.mass is None]
    if bare:
        yield Defect(
            f"{first_few([*map(repr, bare)], 4)} {'have' if len(bare) > 1 else 'has'} no mass.",
            "write masses in kg",
            bodies=tuple(bare),
            field="bodies.mass",
        )


@check(
    "AUD144",
    "warning",
    title="an up axis that is no axis of the body",
    why="Tilt is the angle between the up axis and the vertical: an object whose up axis lies flat at "
    "the start counts as toppled.",
    example="up_axis = (0, 1, 0) for a bottle that was modelled with z up",
    unless=("AUD111", "AUD113"),
)
def declared_up(subject: Subject) -> Iterator[Defect]:
    """Looks for scenes in which no object with an up axis stands upright at the start."""
    if not subject.readable or not len(subject.episode):
        return
    from safestage_eval.geometry.pose import rotate

    tilted: list[Body] = []
    standing = 0
    for body in subject.objects:
        if body.up_axis is None or body.parent is not None:
            continue
        turn = subject.track(body.name).orientation[0]
        if not all_finite(turn):
            continue
        up = rotate(turn.astype(float), np.asarray(body.up_axis) / np.linalg.norm(body.up_axis))
        standing += up[2] > 0.5
        tilted += [body] * bool(up[2] <= 0.5)
    if len(tilted) > 1 and not standing:
        yield Defect(
            f"none of {len(tilted)} objects with an up axis stands upright at the start: "
            f"{first_few([repr(b.name) for b in tilted], 4)}.",
            "declare the axis of the body frame that points up when the object stands",
            "up axes of another convention (y up), or quaternions in another order",
            bodies=tuple(body.name for body in tilted),
            field="bodies.up_axis",
        )
