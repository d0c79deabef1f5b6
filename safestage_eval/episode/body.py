"""Bodies, their shapes, cavities and joints: the part of a scene that does not move in time.

All lengths in metres, masses in kilograms, angles in radians. Poses written ``position`` +
``orientation`` map local coordinates to the parent frame named in the field's docstring;
quaternions are wxyz and of unit norm.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from safestage_eval.errors import nearest

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]

Stored = Annotated[int, Field(ge=-(2**63), lt=2**63)]
"""An integer that files can hold."""

GeomKind = Literal[
    "sphere", "box", "cylinder", "capsule", "ellipsoid", "plane", "convex_mesh", "mesh"
]
BodyKind = Literal["robot", "gripper", "object", "fixture", "region"]

IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)
ORIGIN: Vec3 = (0.0, 0.0, 0.0)


class Record(BaseModel):
    """Base of all stored records: immutable, unknown fields ignored (a newer minor may add some)."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    def __init__(self, **values: Any) -> None:
        """Raises pydantic's ValidationError, with the nearest word where one of a few is allowed."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            for mistake in error.errors(include_url=False):
                allowed = re.findall(r"'([^']*)'", mistake.get("ctx", {}).get("expected", ""))
                if near := nearest(str(mistake["input"]), allowed):
                    error.add_note(f"{mistake['loc'][-1]}: did you mean {near!r}?")
            raise

    # records within a record are made without it, in a third of the time
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


class Geom(Record):
    """One collision shape of a body."""

    name: str = ""
    """Unique within its body when not empty."""
    kind: GeomKind
    size: tuple[float, ...] = ()
    """m. sphere ``(radius,)``; box ``(half_x, half_y, half_z)``; cylinder and capsule
    ``(radius, half_length)`` along local z (a capsule's half length excludes its caps);
    ellipsoid ``(radius_x, radius_y, radius_z)``; plane and meshes ``()``. A plane is the
    half-space local z <= 0."""
    position: Vec3 = ORIGIN
    """m, geom frame in the body frame."""
    orientation: Quat = IDENTITY
    """wxyz, geom frame to body frame."""
    friction: tuple[float, float, float] = (1.0, 0.02, 0.001)
    """Sliding (1), torsional (m), rolling (m). Of two geoms in contact the greater one counts."""
    mesh: str | None = None
    """Key into ``Episode.meshes`` (the mesh's content hash) for ``convex_mesh`` and ``mesh``."""

    def scaled(self, by: float) -> Geom:
        """Return the shape with size and position scaled ``by`` a factor; a mesh keeps its vertices."""
        larger = {"size": self.size, "position": self.position}
        return self.model_copy(
            update={name: tuple(by * x for x in values) for name, values in larger.items()}
        )


class Cavity(Record):
    """The hollow inside of a container. Its frame's +z axis points out of the opening; the rim is its top."""

    kind: Literal["box", "cylinder"]
    size: tuple[float, ...]
    """m. box ``(half_x, half_y, half_z)``; cylinder ``(radius, half_height)``."""
    position: Vec3 = ORIGIN
    """m, centre of the cavity in the body frame."""
    orientation: Quat = IDENTITY
    """wxyz, cavity frame to body frame."""


class Tcp(Record):
    """Tool centre point: local z is the approach direction, local x the closing direction."""

    position: Vec3
    """m, in the body frame."""
    orientation: Quat
    """wxyz, TCP frame to body frame."""


class Body(Record):
    """One rigid body."""

    name: str
    """Unique within the episode."""
    kind: BodyKind
    movable: bool = True
    """False: one pose for the whole episode (tables, the robot's base)."""
    mass: float | None = None
    """kg; None where unknown (fixtures), 0 of a mere frame such as a TCP."""
    com: Vec3 = ORIGIN
    """m, centre of mass in the body frame."""
    inertia: Vec3 | None = None
    """kg m², principal moments about the COM; None where unknown."""
    inertia_orientation: Quat = IDENTITY
    """wxyz, principal frame to body frame."""
    up_axis: Vec3 | None = None
    """Unit vector in the body frame that points up when the object stands as intended;
    None for objects without one (an orange): they have no tilt."""
    finger: Literal["left", "right"] | None = None
    """Side, for the bodies of a gripper that close on an object."""
    tcp: Tcp | None = None
    """On the gripper body that carries it."""
    material: str | None = None
    """Row of ``[material.NAME]`` in rule files."""
    tags: tuple[str, ...] = ()
    """fragile, sharp, heavy, hot, liquid, electronics, … (free)."""
    parent: str | None = None
    """Name of the body this one is jointed to (robot links, drawers)."""
    excluded: tuple[str, ...] = ()
    """Names of the bodies whose contacts with this one the model ignores."""
    geoms: tuple[Geom, ...] = ()
    cavity: Cavity | None = None
    untold: tuple[Literal["up_axis", "cavity", "links"], ...] = ()
    """Fields that are None because the source does not tell, not because there is none; ``links``
    of a robot's base: the robot's other bodies are not recorded. Since 1.1."""

    @property
    def unseen(self) -> bool:
        """Whether its shape is missing: it has none, and is not a mere frame of mass 0 (a TCP, a sensor)."""
        return not self.geoms and self.mass != 0


class Joint(Record):
    """A one-degree-of-freedom joint of the robot or of an articulated fixture."""

    name: str
    kind: Literal["revolute", "prismatic"]
    body: str | None = None
    """The body that the joint moves."""
    limits: tuple[float, float] | None = None
    """rad or m."""
