"""Checks of what is said once about bodies and joints: shapes, masses, fingers, limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safestage_eval._text.plural import first_few
from safestage_eval.audit.audit_check import check
from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject, defect_of
from safestage_eval.episode import Body
from safestage_eval.episode.scene_shapes import body_shapes

from .gravity_checks import BORNE, borne_shares

LARGE, SMALL = 5.0, 5e-4
"""m; radius of the ball around an object that a robot arm has to do with."""


@check(
    "AUD131",
    "error",
    of="recording",
    title="a shape has a size that cannot be",
    why="Clearances, support and edges are measured on the shapes.",
    example="half sizes of a box in millimetres",
    issue="o3de/o3de#13999",
    unless=("AUD101",),
)
def shape_sizes(subject: Subject) -> Iterator[Defect]:
    """Compares shapes with masses (density), contacts, and what a robot arm handles."""
    yield from subject.explained("AUD131", "mass")
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
    of="recording",
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
    "AUD133",
    "error",
    of="recording",
    title="centre of mass or inertia do not belong to the body",
    why="Heights, speeds and balance are those of the centre of mass.",
    example="a centre of mass in world coordinates",
    unless=("AUD131", "AUD132"),
)
def inertia(subject: Subject) -> Iterator[Defect]:
    """Asks for a centre of mass inside the shapes and for moments that such a mass can have."""
    yield from subject.explained("AUD133", "inertia")


@check(
    "AUD134",
    "error",
    of="recording",
    title="a cavity or tool centre point is not at its body",
    why="Containment is decided from the cavity, and the reach of the hand from the tool centre point.",
    example="a cavity in millimetres, a tool centre point in world coordinates",
    unless=("AUD131",),
)
def attachments(subject: Subject) -> Iterator[Defect]:
    """Compares cavities with shapes; a tool centre point is within half a metre of its body."""
    yield from subject.explained("AUD134", "cavity", "tool")


@check(
    "AUD135",
    "warning",
    of="recording",
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
    of="recording",
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
    of="recording",
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
    "AUD138",
    "error",
    of="recording",
    title="a parent or a joint names a body that is not there",
    why="What is jointed to a body that is not recorded seems to float.",
    example="a robot without one of its links",
    cheap=True,
)
def missing_parents(subject: Subject) -> Iterator[Defect]:
    """Looks the names of parents and of moved bodies up among the bodies."""
    errors = subject.of_kind("names")
    if errors:
        yield defect_of(errors)


@check(
    "AUD141",
    "error",
    of="recording",
    title="joints are outside their limits",
    why="Openings of drawers and lids, and joint limits, are judged in rad and m.",
    example="joint positions in degrees",
)
def joint_ranges(subject: Subject) -> Iterator[Defect]:
    """Compares joint positions with the limits of the joints."""
    yield from subject.explained("AUD141", "joint range")


@check(
    "AUD142",
    "error",
    of="recording",
    title="joint velocities are not those of the positions",
    why="Speeds of joints are judged by the velocities.",
    example="joint velocities in degrees per second, or in another order",
    unless=("AUD141",),
)
def joint_velocities(subject: Subject) -> Iterator[Defect]:
    """Adds up joint velocities and compares them with the change of the positions."""
    yield from subject.explained("AUD142", "joint velocity")


@check(
    "AUD143",
    "error",
    of="recording",
    title="the gripper's opening is not between 0 and 1",
    why="0 is closed and 1 is open; where forces are missing, grips are decided from it.",
    example="an opening in metres times 100, or in percent",
)
def opening(subject: Subject) -> Iterator[Defect]:
    """Compares the opening with 0 and 1."""
    yield from subject.explained("AUD143", "opening")


@check(
    "AUD144",
    "warning",
    of="recording",
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
        axis = np.asarray(body.up_axis) / np.linalg.norm(body.up_axis)
        up = rotate(subject.track(body.name).orientation[0].astype(float), axis)
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
