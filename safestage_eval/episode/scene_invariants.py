"""Invariants of the bodies, shapes and joints of every episode."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from math import hypot, inf, isfinite

from safestage_eval.errors import TraceError

from .body import Body, Cavity, Geom, Joint, Tcp
from .camera import Camera

UNIT_TOLERANCE = 1e-3
"""Allowed deviation of a quaternion's norm from 1: float32 rounding with two decades to spare."""

FARTHEST = 1e6
"""m; lengths beyond are no scene of a robot, and lose millimetres in float32 long before."""

_NEAR = FARTHEST / 2
"""m; a vector shorter than this is near in every coordinate, however it is rounded."""

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
        if not _plainly_sound(body):
            yield from _body(body, f"{where}: body {body.name!r}")
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
        yield from _pose(camera, place)


def _body(body: Body, place: str) -> Iterator[TraceError]:
    if body.mass is not None and not (isfinite(body.mass) and body.mass >= 0):
        yield TraceError(place, f"mass is {body.mass}", "kg, finite and not negative")
    yield from _position(body.com, place, "com")
    for value in body.inertia or ():
        if not isfinite(value):
            yield TraceError(place, f"inertia is {body.inertia}", "kg m², finite")
            break
    yield from _quaternion(body.inertia_orientation, place, "inertia_orientation")
    if body.up_axis is not None and not 0 < hypot(*body.up_axis) < float("inf"):
        yield TraceError(place, f"up_axis is {body.up_axis}", "a direction, or none")
    for i, geom in enumerate(body.geoms):
        yield from _geom(geom, f"{place}, geom {i}")
    if body.cavity is not None:
        yield from _cavity(body.cavity, f"{place}, cavity")
    if body.tcp is not None:
        yield from _pose(body.tcp, f"{place}, tcp")


def _geom(geom: Geom, place: str) -> Iterator[TraceError]:
    yield from _sizes(geom.size, SIZE_COUNTS[geom.kind], f"a {geom.kind}", place)
    yield from _pose(geom, place)
    if not all(isfinite(f) and f >= 0 for f in geom.friction):
        yield TraceError(place, f"friction is {geom.friction}", "finite and not negative")
    if (geom.kind in ("mesh", "convex_mesh")) != (geom.mesh is not None):
        yield TraceError(place, f"a {geom.kind} with mesh = {geom.mesh!r}")


def _cavity(cavity: Cavity, place: str) -> Iterator[TraceError]:
    yield from _sizes(cavity.size, _CAVITY_COUNTS[cavity.kind], f"a {cavity.kind}", place)
    yield from _pose(cavity, place)


def _plainly_sound(body: Body) -> bool:
    """Nothing is wrong with its numbers for sure; false where that takes a closer look.

    A fifth of the time of looking closely: nearly every body is sound, and scenes have many shapes.
    """
    if not (body.mass is None or 0 <= body.mass < inf):
        return False
    if body.cavity is not None or body.tcp is not None:
        return False
    if body.inertia is not None and not hypot(*body.inertia) < inf:
        return False
    if body.up_axis is not None and not 0 < hypot(*body.up_axis) < inf:
        return False
    if not (hypot(*body.com) < _NEAR and _is_unit(body.inertia_orientation)):
        return False
    for geom in body.geoms:
        if (geom.kind in ("mesh", "convex_mesh")) != (geom.mesh is not None):
            return False
        size = geom.size
        if len(size) != SIZE_COUNTS[geom.kind] or not hypot(*size) < _NEAR:
            return False
        if size and not min(size) > 0:
            return False
        if not (hypot(*geom.position) < _NEAR and _is_unit(geom.orientation)):
            return False
        if not hypot(*geom.friction) < inf or min(geom.friction) < 0:
            return False
    return True


def _is_unit(quaternion: tuple[float, ...]) -> bool:
    return abs(hypot(*quaternion) - 1) <= UNIT_TOLERANCE


def _sizes(size: tuple[float, ...], count: int, what: str, place: str) -> Iterator[TraceError]:
    if len(size) != count:
        yield TraceError(place, f"{what} with {len(size)} sizes.", f"{count}")
    elif not all(isfinite(s) and s > 0 for s in size):
        yield TraceError(place, f"size {size} is not positive and finite")
    elif any(s > FARTHEST for s in size):
        yield TraceError(place, f"size {size}", f"m, up to {FARTHEST:.0e}")


def _pose(of: Geom | Cavity | Tcp | Camera, place: str) -> Iterator[TraceError]:
    yield from _position(of.position, place, "position")
    yield from _quaternion(of.orientation, place, "orientation")


def _position(position: tuple[float, ...], place: str, what: str) -> Iterator[TraceError]:
    if not all(isfinite(x) and abs(x) <= FARTHEST for x in position):
        yield TraceError(place, f"{what} is {position}", f"m, finite, up to {FARTHEST:.0e}")


def _quaternion(quaternion: tuple[float, ...], place: str, what: str) -> Iterator[TraceError]:
    if not _is_unit(quaternion):
        yield TraceError(place, f"{what} is {quaternion}", "a quaternion w, x, y, z of norm 1")


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
