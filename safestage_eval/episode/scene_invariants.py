"""Invariants of the bodies, shapes and joints of every episode."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from math import hypot, inf, isfinite

from safestage_eval.errors import TraceError

from .body import Body, Cavity, Geom, Joint, Tcp
from .camera import Camera

UNIT_TOLERANCE = 1e-3
"""Allowed deviation of a quaternion's norm from 1: float32 rounding with two decades to spare."""

FARTHEST = 1e6
"""m; lengths beyond are no scene of a robot, and lose millimetres in float32 long before."""

PLACES, TURNS = f"m, finite, up to {FARTHEST:.0e}", "a quaternion w, x, y, z of norm 1"
"""What is allowed of positions and orientations."""

SIZE_COUNTS = {
    "sphere": 1,
    "box": 3,
    "cylinder": 2,
    "capsule": 2,
    "ellipsoid": 3,
    "plane": 0,
    "convex_mesh": 0,
    "mesh": 0,
}
"""Numbers in ``Geom.size`` by kind."""

_CAVITY_COUNTS = {"box": 3, "cylinder": 2}


def check_bodies(bodies: Iterable[Body], where: str) -> Iterator[TraceError]:
    """Shapes, places, masses and parents."""
    known = {body.name: body for body in bodies}
    ends: set[str] = set()
    for body in known.values():
        for part, what, allowed in _body(body):
            yield TraceError(f"{where}: body {body.name!r}{part}", what, allowed)
        if body.parent is not None and _is_its_own_parent(body, known, ends):
            place = f"{where}: body {body.name!r}"
            yield TraceError(place, "it is its own parent, or that of one of its parents")


def check_joints(joints: Iterable[Joint], where: str) -> Iterator[TraceError]:
    """Limits."""
    for joint in joints:
        if joint.limits is not None and not all(map(isfinite, joint.limits)):
            yield TraceError(
                where, f"joint {joint.name!r} has limits {joint.limits}", "finite, or none"
            )


def check_cameras(
    cameras: Iterable[Camera], bodies: Collection[str], where: str
) -> Iterator[TraceError]:
    """Intrinsics, and what carries them."""
    for camera in cameras:
        place = f"{where}: camera {camera.name!r}"
        lens = camera.width, camera.height, camera.fx, camera.fy
        if not all(isfinite(x) and x > 0 for x in lens):
            yield TraceError(place, f"width, height, fx, fy are {lens}", "pixels, positive")
        if not (isfinite(camera.cx) and isfinite(camera.cy)):
            yield TraceError(place, f"cx, cy are {camera.cx, camera.cy}", "pixels, finite")
        if camera.body is not None and camera.body not in bodies:
            yield TraceError(place, f"is on {camera.body!r}, which is no body", ", ".join(bodies))
        for _, what, allowed in _pose(camera, ""):
            yield TraceError(place, what, allowed)


Wrong = tuple[str, str, str]
"""The part of a body, what is wrong with it, and what is allowed."""


def _body(body: Body) -> Iterator[Wrong]:
    if not (body.mass is None or 0 <= body.mass < inf):
        yield "", f"mass is {body.mass}", "kg, finite and not negative"
    if not _near(body.com):
        yield "", f"com is {body.com}", PLACES
    if body.inertia is not None and not all(map(isfinite, body.inertia)):
        yield "", f"inertia is {body.inertia}", "kg m², finite"
    if not _is_unit(body.inertia_orientation):
        yield "", f"inertia_orientation is {body.inertia_orientation}", TURNS
    if body.up_axis is not None and not 0 < hypot(*body.up_axis) < inf:
        yield "", f"up_axis is {body.up_axis}", "a direction, or none"
    for i, geom in enumerate(body.geoms):
        yield from _geom(geom, i)
    if body.cavity is not None:
        yield from _shape(body.cavity, _CAVITY_COUNTS, ", cavity")
    if body.tcp is not None:
        yield from _pose(body.tcp, ", tcp")


def _geom(geom: Geom, number: int) -> Iterator[Wrong]:
    place = f", geom {number}"
    yield from _shape(geom, SIZE_COUNTS, place)
    if not (hypot(*geom.friction) < inf and min(geom.friction) >= 0):
        yield place, f"friction is {geom.friction}", "finite and not negative"
    if (geom.kind in ("mesh", "convex_mesh")) != (geom.mesh is not None):
        yield place, f"a {geom.kind} with mesh = {geom.mesh!r}", ""


def _shape(of: Geom | Cavity, counts: Mapping[str, int], place: str) -> Iterator[Wrong]:
    size = of.size
    if len(size) != counts[of.kind]:
        yield place, f"a {of.kind} with {len(size)} sizes.", f"{counts[of.kind]}"
    elif not all(0 < s <= FARTHEST for s in size):
        yield place, f"size {size}", f"m, positive, up to {FARTHEST:.0e}"
    yield from _pose(of, place)


def _pose(of: Geom | Cavity | Tcp | Camera, place: str) -> Iterator[Wrong]:
    if not _near(of.position):
        yield place, f"position is {of.position}", PLACES
    if not _is_unit(of.orientation):
        yield place, f"orientation is {of.orientation}", TURNS


def _near(place: tuple[float, ...]) -> bool:
    return all(abs(x) <= FARTHEST for x in place)


def _is_unit(quaternion: tuple[float, ...]) -> bool:
    return abs(hypot(*quaternion) - 1) <= UNIT_TOLERANCE


def _is_its_own_parent(body: Body, known: dict[str, Body], ends: set[str]) -> bool:
    """Whether a body's parents lead round to it; ``ends``: those whose parents do not, which grows."""
    seen: set[str] = set()
    at: Body | None = body
    while at is not None and at.name not in seen and at.name not in ends:
        seen.add(at.name)
        at = known.get(at.parent) if at.parent is not None else None
    if at is None or at.name in ends:
        ends |= seen
        return False
    return at.name == body.name
