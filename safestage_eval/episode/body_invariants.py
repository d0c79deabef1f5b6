"""Physical limits of masses, shapes, joints and time steps: nothing outside them can exist.

One function per check; each returns what it found, none of it twice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .body import Body
from .contradiction import POSES, ContradictionError, contradiction
from .frames import RobotFrames
from .header import Header
from .rounding import most_off
from .scene_shapes import BodyShapes, volume

DENSITY = (1.0, 50_000.0)
"""kg/m³; foam has 15, osmium 22,600, and shapes are rough."""

GRAVITY = (1.0, 30.0)
"""m/s²; the Moon has 1.6, Jupiter 24.8."""

ROOM = 0.05
"""m by which a centre of mass or a cavity may lie outside the ball around the shapes."""

ARM = 0.5
"""m; a tool centre point is no further from the body that carries it."""


def check_steps_of_time(header: Header, where: str) -> list[ContradictionError]:
    """A recording has no more frames than the simulation has steps, nor commands than steps."""
    told, found = header.control_dt, []
    if header.physics_dt > 1.01 * header.frame_dt:
        found.append(
            contradiction(
                "steps",
                (),
                where,
                f"physics_dt is {header.physics_dt:.6g} s, more than frame_dt, "
                f"{header.frame_dt:.6g} s: nothing can be recorded between two steps.",
                "physics_dt <= frame_dt, in seconds",
                "look for milliseconds, or a rate in place of a step",
            )
        )
    if told is not None and told < 0.99 * header.physics_dt:
        found.append(
            contradiction(
                "steps",
                (),
                where,
                f"control_dt is {told:.6g} s, less than physics_dt, {header.physics_dt:.6g} s.",
                "control_dt >= physics_dt, in seconds",
                "look for milliseconds, or a rate in place of a step",
            )
        )
    return found


def check_gravity(header: Header, where: str) -> list[ContradictionError]:
    """Gravity is that of a place where robots are."""
    down = -header.gravity[2]
    if GRAVITY[0] <= down <= GRAVITY[1]:
        return []
    return [
        contradiction(
            "gravity",
            (),
            where,
            f"gravity is {down:.6g} m/s².",
            f"{GRAVITY[0]:g} to {GRAVITY[1]:g} m/s²",
            "look for cm/s² or mm/s²",
        )
    ]


def check_ending(header: Header, where: str) -> list[ContradictionError]:
    """``termination``, ``success`` and the time limits do not contradict each other."""
    found = []
    if header.termination == "success" and header.success is False:
        found.append(
            contradiction(
                "ending",
                (),
                where,
                "termination is success, and yet success is false.",
                "success = true, or another termination",
                "correct the header: verdicts on what was left behind hang on it",
            )
        )
    for name in ("horizon", "post_success_hold", "success_time"):
        value = getattr(header, name)
        if value is not None and value < 0:
            found.append(
                contradiction(
                    "ending", (), where, f"{name} is {value:.6g} s.", "seconds, not negative"
                )
            )
    return found


def check_names(header: Header, where: str) -> list[ContradictionError]:
    """Parents, and bodies that joints move, are bodies of the episode."""
    names = {body.name for body in header.bodies}
    told = [(f"the parent of {b.name!r}", b.parent) for b in header.bodies]
    told += [(f"the body that joint {j.name!r} moves", j.body) for j in header.joints]
    return [
        contradiction(
            "names",
            (),
            where,
            f"{what} is {name!r}, which is no body.",
            fix="record that body too: what is jointed to it cannot be judged without it",
        )
        for what, name in told
        if name is not None and name not in names
    ]


def check_mass(body: Body, shapes: BodyShapes, where: str) -> list[ContradictionError]:
    """Mass of an object over the volume of its shapes: some density."""
    room = volume(body, shapes)
    if body.kind != "object" or not body.mass or not 0 < room < np.inf:
        return []
    density = body.mass / room
    light = density < DENSITY[0] and not any(geom.mesh for geom in body.geoms)
    if not light and density <= DENSITY[1]:
        return []
    return [
        contradiction(
            "mass",
            (body.name,),
            where,
            f"{body.name!r} has {body.mass:.4g} kg in {room * 1e6:.4g} cm³: {density:.3g} kg/m³.",
            f"{DENSITY[0]:g} to {DENSITY[1]:,.0f} kg/m³",
            "look for grams, or for shapes in cm or mm",
            hides=(*POSES, "mass", "inertia"),
        )
    ]


def check_inertia(body: Body, shapes: BodyShapes, where: str) -> list[ContradictionError]:
    """Centre of mass and moments of inertia are those of something inside the shapes."""
    reach, found = shapes.radius, []
    if body.kind != "object" or not reach < np.inf:
        return []
    place = float(np.linalg.norm(body.com))
    if place > reach + ROOM:
        found.append(
            contradiction(
                "inertia",
                (body.name,),
                where,
                f"the centre of mass of {body.name!r} is {place:.3g} m from its origin, and its "
                f"shapes end at {reach:.3g} m.",
                "m, in the body frame",
                "look for another unit, or world coordinates",
                hides=(*POSES, "mass", "inertia"),
            )
        )
    if body.inertia is not None and body.mass:
        most, bound = max(body.inertia), body.mass * (reach + place + ROOM) ** 2
        if most > bound or 2 * most > 1.01 * sum(body.inertia) + 1e-12:
            found.append(
                contradiction(
                    "inertia",
                    (body.name,),
                    where,
                    f"the inertia of {body.name!r} is {body.inertia} kg m²: no body of "
                    f"{body.mass:.4g} kg within {reach:.3g} m has it.",
                    f"principal moments up to {bound:.3g} kg m², none above the other two together",
                    "look for another unit (g cm² are 1e-7 kg m²)",
                    hides=("inertia",),
                )
            )
    return found


def check_cavity(body: Body, shapes: BodyShapes, where: str) -> list[ContradictionError]:
    """The room inside a container is inside it."""
    cavity = body.cavity
    if cavity is None or not shapes.radius < np.inf:
        return []
    far = float(np.linalg.norm(cavity.position)) + max(cavity.size)
    if far <= shapes.radius + ROOM:
        return []
    return [
        contradiction(
            "cavity",
            (body.name,),
            where,
            f"the cavity of {body.name!r} reaches {far:.3g} m from its origin, its shapes "
            f"{shapes.radius:.3g} m.",
            "m, in the body frame",
            "look for another unit",
            hides=("cavity",),
        )
    ]


def check_tool(body: Body, where: str) -> list[ContradictionError]:
    """The tool centre point is at the tool."""
    if body.tcp is None or np.linalg.norm(body.tcp.position) <= ARM:
        return []
    far = float(np.linalg.norm(body.tcp.position))
    return [
        contradiction(
            "tool",
            (body.name,),
            where,
            f"the tool centre point of {body.name!r} is {far:.3g} m from it.",
            f"m, in the body frame, up to {ARM}",
            "look for another unit, or world coordinates",
            hides=("tcp",),
        )
    ]


def check_joint_ranges(frames: RobotFrames, header: Header, where: str) -> list[ContradictionError]:
    """Joints stay within their limits (and a tenth, for soft ones); the gripper within 0 … 1."""
    found = []
    for i, joint in enumerate(header.joints):
        if joint.limits is None or i >= frames.joint_position.shape[1]:
            continue
        low, high = joint.limits
        values, slack = frames.joint_position[:, i], 0.1 * (high - low) + 0.05
        with np.errstate(over="ignore"):  # a limit may be larger than any float32
            off = (values < low - slack) | (values > high + slack)
        if high > low and off.any():
            unit = "rad" if joint.kind == "revolute" else "m"
            found.append(
                contradiction(
                    "joint range",
                    (joint.name,),
                    where,
                    f"joint {joint.name!r} is at {values[off][0]:.4g} {unit} in {int(off.sum())} "
                    f"frames, its limits are {low:.4g} to {high:.4g}.",
                    "rad or m, in the order of the header's joints",
                    "look for degrees, mm, or another order of the joints",
                    hides=("joint",),
                )
            )
    off = (frames.gripper < -0.05) | (frames.gripper > 1.05)
    if off.any():
        found.append(
            contradiction(
                "opening",
                (),
                where,
                f"the gripper's opening is {frames.gripper[off][0]:.4g}.",
                "0 (closed) to 1 (open)",
                "divide its width by the greatest one",
                hides=("gripper",),
            )
        )
    return found


def check_joint_speeds(
    t: NDArray[np.float64], frames: RobotFrames, header: Header, where: str
) -> list[ContradictionError]:
    """Joint positions change as their velocities say."""
    from .motion_invariants import DIFFERS, LEAST, LONGEST

    place, rate = (a.astype(np.float64) for a in (frames.joint_position, frames.joint_velocity))
    dt = np.diff(t)
    if place.shape != rate.shape or len(t) < 2 or dt.max() > LONGEST["orientation"]:
        return []
    parts = np.arange(0, len(t), max(1, round(0.25 / float(dt.mean()))))
    went = np.add.reduceat(np.diff(place, axis=0, prepend=place[:1]), parts)
    steps = np.concatenate([np.zeros_like(rate[:1]), (rate[1:] + rate[:-1]) / 2 * dt[:, None]])
    said = np.add.reduceat(steps, parts)
    by_place, by_rate = (np.sqrt(np.nansum(a * a, 0)) for a in (went, said))
    kind, most = "orientation", np.maximum(by_place, by_rate)

    def differ(off: float) -> NDArray[np.bool_]:
        beyond = np.maximum(np.abs(went - said) - off, 0)
        apart = np.sqrt(np.nansum(beyond * beyond, 0))
        return np.asarray((most > LEAST[kind]) & (apart > DIFFERS[kind] * most) & (by_rate > 0))

    wrong = differ(0.0)
    if wrong.any():
        wrong = differ(2 * most_off(frames.joint_position) + 0.25 * most_off(frames.joint_velocity))
    return [
        contradiction(
            "joint velocity",
            (header.joints[i].name,),
            where,
            f"the velocity of joint {header.joints[i].name!r} is not that of its position: the one "
            f"says {by_rate[i]:.3g}, the other {by_place[i]:.3g}.",
            "rad and rad/s, or m and m/s",
            "look for degrees, another order of the joints, or another sign",
            hides=("joint",),
        )
        for i in np.flatnonzero(wrong).tolist()
    ]
