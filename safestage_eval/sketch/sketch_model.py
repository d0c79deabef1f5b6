"""The keys of a sketch's tables and of each step of its story."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from safestage_eval.episode.body import BodyKind

from . import quantities as q


def _of(dimension: str) -> BeforeValidator:
    return BeforeValidator(lambda value: q.quantity(value, dimension))


def _positive(dimension: str) -> BeforeValidator:
    def parse(value: Any) -> float:
        result = q.quantity(value, dimension)
        if not result > 0:
            raise ValueError(f"{value!r} is not positive")
        return result

    return BeforeValidator(parse)


def _names(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


Time = Annotated[float, _of("time")]
Length = Annotated[float, _of("length")]
Angle = Annotated[float, _of("angle")]
Force = Annotated[float, _of("force")]
Mass = Annotated[float, _positive("mass")]
Ratio = Annotated[float, _of("ratio")]
Place = Annotated[q.Vec3, BeforeValidator(lambda v: q.vector(v, components=(2, 3)))]
Way = Annotated[q.Vec3, BeforeValidator(q.vector)]
Push = Annotated[
    float | q.Vec3,
    BeforeValidator(lambda v: (q.vector if "," in str(v) else q.quantity)(v, "force")),
]
Span = Annotated[tuple[float, Annotated[float, Field(allow_inf_nan=True)]], BeforeValidator(q.span)]
"""s, from and to; ∞ is the end of the sketch."""
Turned = Annotated[tuple[float, Literal["x", "y", "z"]], BeforeValidator(q.turn)]
Names = Annotated[tuple[str, ...], BeforeValidator(_names), Field(min_length=1)]
Side = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Shapes = Annotated[
    tuple[q.Part, ...],
    BeforeValidator(lambda v: tuple(q.shape(s) for s in _names(v))),
    Field(min_length=1),
]


class Table(BaseModel):
    """Base of all tables: no unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class BodySketch(Table):
    """One thing in the scene. Its frame's origin is the middle of its bottom."""

    shape: Shapes
    """One shape or several; sizes are outer ones, and each part stands on its ``at``."""
    at: Place = (0.0, 0.0, 0.0)
    """Position in the world; relative to the origin of what it stands ``on`` if that is given."""
    on: str | None = None
    """The body on whose upward face it stands; without it, height 0 or that of ``at``."""
    turned: Turned | None = None
    """Initial rotation about its own origin: ``"30 deg about z"``."""
    mass: Mass = 0.2
    kind: BodyKind = "object"
    movable: bool | None = None
    """Whether it can move; by default all but fixtures and regions."""
    up: Literal["x", "y", "z", "none"] | None = None
    """Declared up axis; by default z, and none for a sphere or an ellipsoid."""
    material: str | None = None
    tags: Names | tuple[()] = ()
    friction: Ratio = 1.0
    finger: Literal["left", "right"] | None = None
    parent: str | None = None


class JointSketch(Table):
    """A joint with curves of its position and torque."""

    kind: Literal["revolute", "prismatic"] = "revolute"
    body: str | None = None
    limits: Annotated[
        tuple[float, float] | None,
        BeforeValidator(lambda v: tuple(k[1] for k in _ends(v))),
    ] = None
    """``"-90 deg to 90 deg"``."""
    position: Annotated[
        tuple[tuple[float, float], ...], BeforeValidator(lambda v: q.curve(v, ("angle", "length")))
    ]
    torque: Annotated[
        tuple[tuple[float, float], ...], BeforeValidator(lambda v: q.curve(v, ("torque", "force")))
    ] = ((0.0, 0.0),)


def _ends(value: Any) -> tuple[tuple[float, float], ...]:
    low, to, high = str(value).partition(" to ")
    if not to:
        raise ValueError(f'{value!r} are no limits: "-90 deg to 90 deg"')
    return q.curve(f"{low} at 0 s, {high} at 1 s", ("angle", "length"))


class Step(Table):
    """Base of all steps. The first key, the verb, says which kind of step it is."""

    verb: ClassVar[str]


class Hold(Step):
    """The gripper holds a body, and goes with it. Held off the ground it bears its weight."""

    verb = "hold"
    hold: str
    during: Span
    grip: Force = 20.0
    """Force of each finger."""
    across: Literal["x", "y"] = "y"
    """World axis along which the fingers close."""
    height: Length | None = None
    """Height of the grip above the body's origin; three quarters up by default."""


class Move(Step):
    """Bodies go straight, at even speed; by a way, or to where the first one's origin shall be."""

    verb = "move"
    move: Names
    during: Span
    by: Way | None = None
    to: Way | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Move:
        if (self.by is None) == (self.to is None):
            raise ValueError("a move goes either by a way or to a place")
        return self


class Turn(Step):
    """Bodies turn at an even rate about a world axis through the first one's centre of mass."""

    verb = "turn"
    turn: Names
    during: Span
    by: Angle
    about: Literal["x", "y", "z"] = "z"


class Tip(Step):
    """Bodies tip over the edge of the first one's bottom."""

    verb = "tip"
    tip: Names
    during: Span
    by: Angle
    toward: Literal["+x", "-x", "+y", "-y"] = "+x"


class Roll(Step):
    """A round body rolls without slipping."""

    verb = "roll"
    roll: str
    during: Span
    by: Way


class Drop(Step):
    """A body falls freely, until it meets the highest upward face beneath it."""

    verb = "drop"
    drop: str
    at: Time
    by: Annotated[float, _positive("length")] | None = None
    """Distance; by default until something is beneath its origin."""


class Touch(Step):
    """A recorded contact force on a body.

    With ``by = "gripper"`` the gripper goes there; a part of it (``hand``, ``finger_left``, ``finger_right``) touches from where it
    is.
    """

    verb = "touch"
    touch: str
    by: str
    during: Span
    force: Push
    """Force straight into the touched side; or the whole vector, world axes."""
    side: Side = "+x"
    """The side of the touched body, world axes: where, and against which normal."""
    at: Way | None = None
    """Point relative to the touched body's origin; the middle of that side by default."""
    peak: Force | None = None
    """Largest force between the frames; by default that at the frame."""


class Reach(Step):
    """The empty gripper stands at a place."""

    verb = "reach"
    reach: Way
    during: Span


class Channel(Step):
    """A recorded scalar of a body: ``values = "20 degC at 0 s, 80 degC at 2 s"``."""

    verb = "channel"
    channel: str
    of: str
    values: Annotated[
        tuple[tuple[float, float], ...],
        BeforeValidator(lambda v: q.curve(v, ("ratio", *(d for d in q.UNITS if d != "ratio")))),
    ]


STEPS: dict[str, type[Step]] = {
    step.verb: step for step in (Hold, Move, Turn, Tip, Roll, Drop, Touch, Reach, Channel)
}
"""Verb → step."""


class Sketch(Table):
    """A whole scene and what happens in it."""

    says: str
    """One sentence on the event."""
    duration: Time
    rate: Annotated[int, Field(ge=1, le=1000)] = 60
    """Frames per second."""
    success: Annotated[
        float | Literal[False, "unknown"],
        BeforeValidator(lambda v: v if v in (False, "unknown") else q.quantity(v, "time")),
    ] = False
    """When the native goal is reached; false if never; "unknown" if the trace does not tell."""
    termination: Literal["success", "horizon", "policy", "error", "truncated"] | None = None
    forces: bool = True
    """Whether contact forces are recorded."""
    table: Annotated[
        tuple[float, float, float] | Literal[False],
        BeforeValidator(lambda v: v if v is False else q.vector(v, components=(2,))),
    ] = (1.6, 1.6, 0.0)
    """Length and width of the table under it all, its top at height 0; false for none."""
    gripper: bool = True
    """Whether there is one: a hand and two fingers, waiting at the side when not needed."""
    knobs: dict[str, str] = {}
    """Name → default: put into every string of the file where {name} stands."""
    roles: dict[str, Names] = {}
    goal: str | None = None
    parameters: dict[str, str] = {}
    bodies: dict[str, BodySketch] = {}
    joints: dict[str, JointSketch] = {}
    story: tuple[Any, ...] = ()
    """Steps in any order; those of one body are carried out by when they begin."""
