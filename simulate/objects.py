"""The catalogue of everyday objects: shapes, masses, friction, and where they can be gripped."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from safestage_eval.episode import Cavity, Quat, Vec3

from .errors import SceneError

CATALOGUE = Path(__file__).parent / "objects.toml"


class Entry(BaseModel):
    """Base of everything read from this package's TOML files: unknown keys are mistakes."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Part(Entry):
    """One primitive of an object; pose in the body frame, sizes as in ``episode.Geom``."""

    kind: Literal["sphere", "box", "cylinder", "capsule", "ellipsoid"]
    size: tuple[float, ...]
    position: Vec3 = (0.0, 0.0, 0.0)
    orientation: Quat = (1.0, 0.0, 0.0, 0.0)
    mass: float = Field(0.0, ge=0)
    """kg; fixed objects need none."""


class Ring(Entry):
    """A rim: equal boxes in a circle around z, each leaning outwards and up by ``slope``."""

    radius: float
    """m, of the circle of the boxes' centres."""
    count: int
    size: Vec3
    """m, half sizes: radial, tangential, vertical."""
    height: float
    """m, of the centres."""
    slope: float
    """degrees."""
    mass: float
    """kg, of the whole ring."""

    def parts(self) -> list[Part]:
        """The boxes."""
        lean = np.radians(self.slope) / 2
        found = []
        for k in range(self.count):
            turn = np.pi * k / self.count
            angle = 2 * turn
            # about z by the box's angle, then about its own y so that the outer end rises
            c, s, cl, sl = np.cos(turn), np.sin(turn), np.cos(lean), -np.sin(lean)
            found.append(
                Part(
                    kind="box",
                    size=self.size,
                    position=(
                        float(self.radius * np.cos(angle)),
                        float(self.radius * np.sin(angle)),
                        self.height,
                    ),
                    orientation=(float(c * cl), float(-s * sl), float(c * sl), float(s * cl)),
                    mass=self.mass / self.count,
                )
            )
        return found


class Grasp(Entry):
    """Where and from where the gripper closes on an object."""

    position: Vec3
    """m, tool centre point in the body frame."""
    yaw: float = 0.0
    """degrees, closing direction from the body's x axis (from the world's x for ``up = none``)."""
    pitch: float = 0.0
    """degrees, approach from straight down (0) towards horizontal (90), away from the robot."""


class CatalogueObject(Entry):
    """One kind of object. Lengths in metres, masses in kilograms."""

    geoms: tuple[Part, ...]
    ring: Ring | None = None
    material: str | None = None
    tags: tuple[str, ...] = ()
    up: Literal["z", "none"] = "z"
    fixed: bool = False
    base: float = 0.0
    """m by which the origin stands above the support (0: the origin is at the bottom)."""
    surface: float = 0.0
    """m above the origin: where something set on it or into it stands."""
    cavity: Cavity | None = None
    grasp: dict[str, Grasp] = Field(default_factory=dict)
    friction: float = 1.0
    rolling: float = 0.001
    """Rolling friction; spheres below .001 roll for ever."""
    rgba: tuple[float, float, float, float] = (0.6, 0.6, 0.6, 1.0)

    @property
    def parts(self) -> tuple[Part, ...]:
        """All primitives, a ring's included."""
        return self.geoms + tuple(self.ring.parts() if self.ring else ())


T = TypeVar("T", bound=Entry)


@cache
def catalogue(path: Path = CATALOGUE) -> dict[str, CatalogueObject]:
    """Kind → object.

    Raises:
        SceneError: the file does not follow the schema.
    """
    found = {}
    for kind, table in tomllib.loads(path.read_text("utf-8")).items():
        found[kind] = parse(CatalogueObject, table, f"{path.name}, [{kind}]")
    return found


def parse(model: type[T], table: object, where: str) -> T:
    """A table of a TOML file as a checked record; the first mistake is told.

    Raises:
        SceneError: unknown or missing keys, or values of the wrong type.
    """
    try:
        return model.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(step) for step in first["loc"])
        allowed = ", ".join(model.model_fields) if first["type"] == "extra_forbidden" else ""
        raise SceneError(f"{where}: {place}", f"{first['msg']}.", allowed) from None
