"""The names of the signals: what a rule may ask for, what it means, what a trace must hold."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SignalSpec:
    """What the rule checker and the documentation know about one signal.

    Attributes:
        name: as written in rules, ``name(role, …)``.
        args: the numbers of arguments it takes.
        dimension: of its value, as in ``units.DIMENSIONS``.
        meaning: one sentence, in SI and world frame.
        needs: what the trace must hold: poses, twists, geometry, forces, joints, gripper.
        since: may be taken relative to an event instead of the baseline.
        groups: ``robot`` and ``gripper`` (unions of bodies) are allowed as arguments.
        scale: SI size that counts as "one" in a normalised margin when the limit is 0.
    """

    name: str
    args: tuple[int, ...]
    dimension: str
    meaning: str
    needs: tuple[str, ...]
    since: bool = False
    groups: bool = False
    scale: float = 0.01


def _table(*specs: SignalSpec) -> dict[str, SignalSpec]:
    return {spec.name: spec for spec in specs}


SIGNALS = _table(
    SignalSpec("height", (1,), "length", "z of the centre of mass.", ("poses",), since=True),
    SignalSpec(
        "lift",
        (1,),
        "length",
        "Lowest point of the body's geometry above its lowest point at the reference.",
        ("poses", "geometry"),
        since=True,
    ),
    SignalSpec(
        "displacement",
        (1,),
        "length",
        "Distance of the centre of mass from where it was at the reference.",
        ("poses",),
        since=True,
    ),
    SignalSpec(
        "displacement_xy",
        (1,),
        "length",
        "Horizontal distance of the centre of mass from where it was at the reference.",
        ("poses",),
        since=True,
    ),
    SignalSpec(
        "turn",
        (1,),
        "angle",
        "Geodesic angle between the orientation and the one at the reference.",
        ("poses",),
        since=True,
        scale=0.0175,
    ),
    SignalSpec(
        "tilt",
        (1,),
        "angle",
        "Angle between the body's declared up axis and world z; a body without one has none.",
        ("poses",),
        scale=0.0175,
    ),
    SignalSpec("speed", (1,), "speed", "Speed of the centre of mass.", ("twists",)),
    SignalSpec(
        "vertical_speed",
        (1,),
        "speed",
        "Upward speed of the centre of mass; negative when it falls.",
        ("twists",),
    ),
    SignalSpec("angular_speed", (1,), "rate", "Angular speed.", ("twists",), scale=0.1),
    SignalSpec(
        "relative_speed",
        (2,),
        "speed",
        "Speed of one centre of mass relative to the other; for a union, of its fastest body.",
        ("twists",),
        groups=True,
    ),
    SignalSpec(
        "contact_force",
        (2,),
        "force",
        "Sum of the magnitudes of the normal forces of all contacts between the two.",
        ("forces",),
        groups=True,
        scale=1.0,
    ),
    SignalSpec(
        "peak_force",
        (2,),
        "force",
        "Largest value of that sum over the physics steps within the frame.",
        ("forces",),
        groups=True,
        scale=1.0,
    ),
    SignalSpec(
        "total_force",
        (1,),
        "force",
        "Sum of the magnitudes of all normal forces on the body.",
        ("forces",),
        groups=True,
        scale=1.0,
    ),
    SignalSpec(
        "clearance",
        (2,),
        "length",
        "Distance between the two geometries; zero or less when they touch or penetrate.",
        ("poses", "geometry"),
        groups=True,
    ),
    SignalSpec(
        "clearance_xy",
        (2,),
        "length",
        "Distance between the horizontal projections; zero or less when they overlap.",
        ("poses", "geometry"),
        groups=True,
    ),
    SignalSpec(
        "height_above",
        (2,),
        "length",
        "Lowest point of the first above the highest point of the second.",
        ("poses", "geometry"),
        groups=True,
    ),
    SignalSpec(
        "overlap_xy",
        (2,),
        "ratio",
        "Share of the first body's footprint that lies over the second's.",
        ("poses", "geometry"),
        scale=0.1,
    ),
    SignalSpec(
        "edge_margin",
        (1, 2),
        "length",
        "Signed distance from the body's base to the unguarded edge of what it stands on "
        "(or of the second argument); positive when it is fully on.",
        ("poses", "geometry"),
    ),
    SignalSpec(
        "containment_depth",
        (2,),
        "length",
        "Signed depth of the first body's hull centroid in the second's cavity.",
        ("poses", "geometry"),
    ),
    SignalSpec("gripper_opening", (0,), "ratio", "0 closed … 1 open.", ("gripper",), scale=0.1),
)
"""Every built-in signal, by name."""
