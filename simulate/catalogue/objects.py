"""Everyday objects made of primitives, with real dimensions and masses, from ``catalogue``."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from safestage_eval.episode import Cavity, Quat, Vec3
from safestage_eval.errors import InputError

from .surfaces import ROLLING, SAME, SURFACES, friction

KINDS = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}


REGION_ALPHA = 0.25
"""A region is seen through."""


class Strict(BaseModel):
    """Base of everything read from TOML here: immutable, and no key goes unread."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class Shape(Strict):
    """One primitive of an object."""

    kind: Literal["sphere", "box", "cylinder", "capsule", "ellipsoid"]
    size: tuple[float, ...]
    """m, as in ``episode.Geom.size``."""
    position: Vec3 = (0.0, 0.0, 0.0)
    """m, in the object's frame, whose origin is the middle of its bottom."""
    orientation: Quat = (1.0, 0.0, 0.0, 0.0)
    """wxyz."""
    share: float | None = None
    """Share of the object's mass; by volume where not given."""
    color: tuple[float, float, float] | None = None


class Ring(Strict):
    """A rim: boxes in a circle, standing for a thin wall."""

    count: int = 16
    radius: float
    """m, of the circle through the boxes' middles."""
    thickness: float
    """m, radial."""
    height: float
    """m."""
    z: float
    """m, middle of the boxes above the origin."""


class ObjectModel(Strict):
    """Model of an object: shapes, mass, surface, up axis, cavity."""

    mass: float = Field(default=0.0, ge=0)
    """kg; a region has none."""
    shapes: tuple[Shape, ...] = ()
    ring: Ring | None = None
    up: bool = True
    """Whether it has an up axis (+z of its frame); False for objects that may lie any way, like fruit."""
    fixed: bool = False
    """Whether it is fixed, like a shelf."""
    region: bool = False
    """A room and no thing: nothing can touch it, rules can forbid it. Always fixed."""
    material: str | None = None
    """Name that rules know it by."""
    surface: str | None = None
    """Name in ``SURFACES``, where its outside is of something else than ``material``."""
    rolling: float = ROLLING
    """m, rolling friction."""
    tags: tuple[str, ...] = ()
    cavity: Cavity | None = None
    solref: tuple[float, float] = (0.02, 1.0)
    """MuJoCo's contact time constant (s) and damping ratio; below 1 it bounces."""
    color: tuple[float, float, float] = (0.6, 0.6, 0.6)
    height: float = Field(gt=0)
    """m, from bottom to top as it stands."""

    @model_validator(mode="after")
    def _has_shape(self) -> ObjectModel:
        if not self.shapes and self.ring is None:
            raise ValueError("an object needs shapes or a ring")
        if self.region and not self.fixed:
            raise ValueError("a region does not move: add fixed = true")
        if self.region == (self.mass > 0):
            raise ValueError("a thing has a mass above 0, a region has none")
        if self.covering not in SURFACES:
            allowed = ", ".join([*SURFACES, *SAME])
            raise ValueError(f"no friction is known of {self.covering!r}, only of {allowed}")
        return self

    @property
    def covering(self) -> str:
        """Surface that it has: by its material where not said, plastic where that is not either."""
        surface = self.surface or self.material or "plastic"
        return SAME.get(surface, surface)

    @property
    def friction(self) -> tuple[float, float, float]:
        """Sliding (-), torsional (m), rolling (m)."""
        return friction(self.covering, self.rolling)

    def parts(self) -> list[Shape]:
        """All primitives, the ring's boxes among them."""
        out = list(self.shapes)
        if self.ring is not None:
            ring = self.ring
            width = ring.radius * np.tan(np.pi / ring.count) + ring.thickness / 2
            for angle in np.arange(ring.count) * (2 * np.pi / ring.count):
                x, y = ring.radius * np.cos(angle), ring.radius * np.sin(angle)
                out.append(
                    Shape(
                        kind="box",
                        size=(ring.thickness / 2, float(width), ring.height / 2),
                        position=(float(x), float(y), ring.z),
                        orientation=(float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))),
                    )
                )
        return out

    def add_to(self, spec: mujoco.MjSpec, name: str) -> None:
        """Add it to a scene as a body of that name, free unless fixed."""
        body = spec.worldbody.add_body(name=name)
        if not self.fixed:
            body.add_freejoint(name=f"{name}/free")
        parts = self.parts()
        volumes = np.array([_volume(part) for part in parts])
        given = np.array([part.share if part.share is not None else np.nan for part in parts])
        rest = 1 - np.nansum(given)
        open_ = np.isnan(given)
        shares = np.where(open_, rest * volumes / max(volumes[open_].sum(), 1e-12), given)
        for i, (part, share) in enumerate(zip(parts, shares, strict=True)):
            body.add_geom(
                name=f"{name}/{i}",
                type=KINDS[part.kind],
                size=[*part.size, 0.0, 0.0][:3],
                pos=part.position,
                quat=part.orientation,
                mass=float(self.mass * share),
                friction=self.friction,
                condim=6,
                solref=self.solref,
                rgba=[*(part.color or self.color), REGION_ALPHA if self.region else 1.0],
                contype=0 if self.region else 1,
                conaffinity=0 if self.region else 1,
            )


def _volume(part: Shape) -> float:
    s = part.size
    return float(
        {
            "sphere": lambda: 4 / 3 * np.pi * s[0] ** 3,
            "box": lambda: 8 * s[0] * s[1] * s[2],
            "cylinder": lambda: 2 * np.pi * s[0] ** 2 * s[1],
            "capsule": lambda: 2 * np.pi * s[0] ** 2 * s[1] + 4 / 3 * np.pi * s[0] ** 3,
            "ellipsoid": lambda: 4 / 3 * np.pi * s[0] * s[1] * s[2],
        }[part.kind]()
    )


@cache
def catalogue() -> dict[str, ObjectModel]:
    """Every object in the files of ``simulate/catalogue``, by name."""
    out: dict[str, ObjectModel] = {}
    for path in sorted(Path(__file__).parent.glob("*.toml")):
        for name, row in tomllib.loads(path.read_text(encoding="utf-8")).items():
            if name in out:
                raise InputError(str(path), f"object {name!r} is in another file already")
            out[name] = ObjectModel.model_validate(row)
    return out
