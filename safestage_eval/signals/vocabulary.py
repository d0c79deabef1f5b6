"""The names of the signals: what a rule may ask for, what it means, what a trace must hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from safestage_eval.units import UNIT_DIMENSION

from . import options as opt


@dataclass(frozen=True)
class SignalSpec:
    """What the rule checker and the documentation know about one signal.

    Attributes:
        name: as written in rules, ``name(role, …)``.
        args: the numbers of arguments it takes.
        dimension: of its value, as in ``units.DIMENSIONS``.
        meaning: one sentence, in SI and world frame.
        needs: what the trace must hold: poses, twists, geometry, forces, masses, joints, channel,
            gripper; touch: forces or, less well, geometry.
        since: may be taken relative to an event instead of the baseline.
        groups: ``robot`` and ``gripper`` (unions of bodies) are allowed as arguments.
        scale: SI size that counts as "one" in a normalised margin when the limit is 0.
        options: what a ``[signal.NAME]`` with this base may add.
        columns: material columns that it reads, with their dimensions.
        joints: its arguments are joints, or bodies that have just one.
        named: its first argument is the value of this option, not a role.
    """

    name: str
    args: tuple[int, ...]
    dimension: str
    meaning: str
    needs: tuple[str, ...]
    since: bool = False
    groups: bool = False
    scale: float = 0.01
    options: tuple[opt.OptionSpec, ...] = ()
    columns: tuple[tuple[str, str], ...] = ()
    joints: bool = False
    named: str = ""

    def variant(self, given: Mapping[str, object]) -> SignalSpec:
        """The signal with some options given: its dimension and arguments may change with them."""
        if not given:
            return self
        known = {option.name: option for option in self.options}
        unit = given.get("unit")
        dimension = UNIT_DIMENSION.get(str(unit), "number") if unit is not None else self.dimension
        named = bool(self.named and self.named in given)
        return replace(
            self,
            dimension=dimension if "unit" in known else self.dimension,
            args=tuple(n - 1 for n in self.args) if named else self.args,
            named="" if named else self.named,
            options=tuple(o for o in self.options if o.name not in given),
        )

    def split(self, args: tuple[str, ...]) -> tuple[tuple[str, ...], opt.Options]:
        """Arguments as written → those that are roles, and the option that the first may be."""
        if not self.named:
            return args, ()
        return args[1:], ((self.named, args[0]),)


_DAMAGE = (
    ("damage_threshold", "force"),
    ("damage_scale", "ratio"),
    ("impact_sensitivity", "ratio"),
    ("hold_sensitivity", "ratio"),
)


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
        options=(opt.NORM,),
    ),
    SignalSpec(
        "displacement_xy",
        (1,),
        "length",
        "Horizontal distance of the centre of mass from where it was at the reference.",
        ("poses",),
        since=True,
        options=(opt.NORM,),
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
        "impulse",
        (2,),
        "impulse",
        "Time integral of the contact force since the two last began to touch; 0 when they do not.",
        ("forces",),
        groups=True,
        scale=0.1,
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
        "load_share",
        (2,),
        "ratio",
        "Share of all upward force on the first body that the second exerts.",
        ("touch",),
        scale=0.1,
    ),
    SignalSpec(
        "support_margin",
        (1,),
        "length",
        "Signed distance of the projected centre of mass of the body and everything that rests on "
        "it from the edge of the polygon of its support contacts; positive when it stands firm.",
        ("forces", "masses"),
    ),
    SignalSpec(
        "tipping_angle",
        (1,),
        "angle",
        "Angle whose tangent is the support margin over the height of that centre of mass above "
        "the support: by how much it may be tilted before it topples.",
        ("forces", "masses"),
        scale=0.0175,
    ),
    SignalSpec(
        "containment_depth",
        (2,),
        "length",
        "Signed depth of the first body's hull centroid in the second's cavity.",
        ("poses", "geometry"),
    ),
    SignalSpec(
        "slip",
        (1,),
        "length",
        "How far the centre of mass went in the gripper's frame since it was grasped.",
        ("poses", "touch"),
        since=True,
    ),
    SignalSpec(
        "impact",
        (1,),
        "force",
        "Mass times change of velocity over a stated time, divided by that time.",
        ("twists", "masses"),
        scale=1.0,
        options=(opt.OVER,),
    ),
    SignalSpec(
        "quasistatic_force",
        (1,),
        "force",
        "Sum of the normal forces on the body, each without its part along the change of velocity.",
        ("forces", "twists"),
        scale=1.0,
        options=(opt.OVER,),
    ),
    SignalSpec(
        "damage",
        (1,),
        "ratio",
        "Health that the body would lose over the stated time, by its material.",
        ("forces", "twists", "masses"),
        scale=0.1,
        options=(opt.OVER,),
        columns=_DAMAGE,
    ),
    SignalSpec(
        "health",
        (1,),
        "ratio",
        "What is left of 100 % after all damage so far; it only falls.",
        ("forces", "twists", "masses"),
        scale=0.1,
        options=(opt.OVER,),
        columns=_DAMAGE,
    ),
    SignalSpec(
        "workspace_margin",
        (1,),
        "length",
        "Signed distance from the body to the faces of a box, inside positive.",
        ("poses", "geometry"),
        groups=True,
        options=(opt.BOX,),
    ),
    SignalSpec(
        "self_clearance",
        (0,),
        "length",
        "Least distance between bodies of the robot that the model lets collide.",
        ("poses", "geometry"),
    ),
    SignalSpec(
        "joint_torque",
        (1,),
        "torque",
        "Torque of the joint's actuator, with its sign.",
        ("joints",),
        scale=1.0,
        options=(opt.JOINT_FORCE_UNIT,),
        joints=True,
    ),
    SignalSpec(
        "joint_speed",
        (1,),
        "rate",
        "Velocity of the joint, with its sign.",
        ("joints",),
        scale=0.1,
        options=(opt.JOINT_SPEED_UNIT,),
        joints=True,
    ),
    SignalSpec(
        "joint_opening",
        (1,),
        "ratio",
        "Position between the joint's limits: 0 closed (the limit nearer to zero) … 1 open.",
        ("joints",),
        scale=0.1,
        joints=True,
    ),
    SignalSpec(
        "channel",
        (2,),
        "number",
        "A recorded scalar of the body, by its name: temperature, fill level, …",
        ("channel",),
        groups=True,
        scale=1.0,
        options=(opt.CHANNEL, opt.CHANNEL_UNIT),
        named="channel",
    ),
    SignalSpec("gripper_opening", (0,), "ratio", "0 closed … 1 open.", ("gripper",), scale=0.1),
)
"""Every built-in signal, by name."""
