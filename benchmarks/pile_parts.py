"""Bodies of a pile as MJCF. Lengths in m, densities in kg/m³."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

STEP = 1 / 240
"""s, of the physics."""


@dataclass
class Pile:
    """Bodies as MJCF, under names; what begins with ``fix`` is part of the furniture."""

    xml: list[str] = field(default_factory=list)

    def add(
        self, name: str, at: Sequence[float], *geoms: str, euler: Sequence[float] = (0, 0, 0)
    ) -> None:
        """A body at a place (m), turned by ``euler`` (degrees)."""
        joint = "" if name.startswith("fix") else "<freejoint/>"
        self.xml.append(
            f'<body name="{name}" pos="{_text(at)}" euler="{_text(euler)}">{joint}{"".join(geoms)}'
            "</body>"
        )


def _text(values: Sequence[float]) -> str:
    return " ".join(f"{v:.6g}" for v in values)


def box(x: float, y: float, z: float, *, at: Sequence[float] = (0, 0, 0), dense: float = 600.0,
        euler: Sequence[float] = (0, 0, 0)) -> str:  # fmt: skip
    """A box of half lengths."""
    return (
        f'<geom type="box" size="{_text((x, y, z))}" pos="{_text(at)}" euler="{_text(euler)}" '
        f'mass="{8 * x * y * z * dense:.6g}"/>'
    )


def cylinder(r: float, h: float, *, dense: float = 600.0, euler: Sequence[float] = (0, 0, 0),
             at: Sequence[float] = (0, 0, 0)) -> str:  # fmt: skip
    """A cylinder of radius and half length."""
    return (
        f'<geom type="cylinder" size="{_text((r, h))}" pos="{_text(at)}" euler="{_text(euler)}" '
        f'mass="{2 * np.pi * r * r * h * dense:.6g}"/>'
    )


def ball(r: float, *, dense: float = 600.0) -> str:
    """A ball."""
    return f'<geom type="sphere" size="{r:.6g}" mass="{4.2 * r**3 * dense:.6g}"/>'


def open_box(x: float, y: float, z: float, wall: float = 0.005, dense: float = 600.0) -> list[str]:
    """Floor and four walls around an inside of these half lengths; the floor's underside is z = 0."""
    full = 2 * z + wall
    return [
        box(x + wall, y + wall, wall / 2, at=(0, 0, wall / 2), dense=dense),
        *(box(wall / 2, y + wall, z, at=(s * (x + wall / 2), 0, full - z), dense=dense)
          for s in (-1, 1)),
        *(box(x, wall / 2, z, at=(0, s * (y + wall / 2), full - z), dense=dense) for s in (-1, 1)),
    ]  # fmt: skip


def mjcf(pile: Pile, friction: float) -> str:
    """The whole model, on a floor."""
    return (
        f'<mujoco><option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="50"/>'
        f'<default><geom condim="4" friction="{friction} .005 .0001"/></default><worldbody>'
        '<body name="fix_floor"><geom type="plane" size="2 2 .1"/></body>'
        + "".join(pile.xml)
        + "</worldbody></mujoco>"
    )
