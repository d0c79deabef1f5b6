"""Checks of what is said once of bodies: masses, inertia, cavities, tool centre points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safestage_eval.episode.contradiction import POSES, ContradictionError, doubt
from safestage_eval.episode.scene_shapes import volume

from .check_registry import check
from .columns import Columns

CODES = ("AUD131", "AUD133", "AUD134")
"""The checks below; each scene is checked once."""

DENSITY = (1.0, 50_000.0)
"""kg/m³; foam has 15, osmium 22,600, and shapes are rough."""

ROOM = 0.05
"""m by which a centre of mass or a cavity may lie outside the ball around the shapes."""

ARM = 0.5
"""m; a tool centre point is no further from the body that carries it."""


@check(
    "AUD131",
    "error",
    title="a shape has a size that cannot be",
    why="Clearances, support and edges are measured on the shapes.",
    example="half sizes of a box in millimetres",
    issue="o3de/o3de#13999",
    unless=("AUD101",),
    over="columns",
)
def shape_sizes(columns: Columns) -> Iterator[ContradictionError]:
    """Asks for a density of masses and shapes that something has."""
    for body, shapes in columns.solid():
        room = volume(body, shapes)
        if not body.mass or not 0 < room < np.inf:
            continue
        density = body.mass / room
        light = density < DENSITY[0] and not any(geom.mesh for geom in body.geoms)
        if light or density > DENSITY[1]:
            yield doubt(
                f"{body.name!r} has {body.mass:.4g} kg in {room * 1e6:.4g} cm³: {density:.3g} kg/m³.",
                f"{DENSITY[0]:g} to {DENSITY[1]:,.0f} kg/m³",
                "look for grams, or for shapes in cm or mm",
                bodies=(body.name,),
                hides=(*POSES, "mass", "inertia"),
            )


@check(
    "AUD133",
    "error",
    title="centre of mass or inertia do not belong to the body",
    why="Heights, speeds and balance are those of the centre of mass.",
    example="a centre of mass in world coordinates",
    unless=("AUD131", "AUD132"),
    over="columns",
)
def inertia(columns: Columns) -> Iterator[ContradictionError]:
    """Asks for a centre of mass inside the shapes and for moments that such a mass can have."""
    for body, shapes in columns.solid():
        reach, place = shapes.radius, float(np.linalg.norm(body.com))
        if not reach < np.inf:
            continue
        if place > reach + ROOM:
            yield doubt(
                f"the centre of mass of {body.name!r} is {place:.3g} m from its origin, and its "
                f"shapes end at {reach:.3g} m.",
                "m, in the body frame",
                "look for another unit, or world coordinates",
                bodies=(body.name,),
                hides=(*POSES, "mass", "inertia"),
            )
        if body.inertia is None or not body.mass:
            continue
        most, bound = max(body.inertia), body.mass * (reach + place + ROOM) ** 2
        if most > bound or 2 * most > 1.01 * sum(body.inertia) + 1e-12:
            yield doubt(
                f"the inertia of {body.name!r} is {body.inertia} kg m²: no body of "
                f"{body.mass:.4g} kg within {reach:.3g} m has it.",
                f"principal moments up to {bound:.3g} kg m², none above the other two together",
                "look for another unit (g cm² are 1e-7 kg m²)",
                bodies=(body.name,),
                hides=("inertia",),
            )


@check(
    "AUD134",
    "error",
    title="a cavity or tool centre point is not at its body",
    why="Containment is decided from the cavity, and the reach of the hand from the tool centre point.",
    example="a cavity in millimetres, a tool centre point in world coordinates",
    unless=("AUD131",),
    over="columns",
)
def attachments(columns: Columns) -> Iterator[ContradictionError]:
    """Compares cavities with shapes; a tool centre point is within half a metre of its body."""
    for body, shapes in columns.solid():
        if body.cavity is None or not shapes.radius < np.inf:
            continue
        far = float(np.linalg.norm(body.cavity.position)) + max(body.cavity.size)
        if far > shapes.radius + ROOM:
            yield doubt(
                f"the cavity of {body.name!r} reaches {far:.3g} m from its origin, its shapes "
                f"{shapes.radius:.3g} m.",
                "m, in the body frame",
                "look for another unit",
                bodies=(body.name,),
                hides=("cavity",),
            )
    for body in columns.scene():
        far = 0.0 if body.tcp is None else float(np.linalg.norm(body.tcp.position))
        if far > ARM:
            yield doubt(
                f"the tool centre point of {body.name!r} is {far:.3g} m from it.",
                f"m, in the body frame, up to {ARM}",
                "look for another unit, or world coordinates",
                bodies=(body.name,),
                hides=("tcp",),
            )
