"""A room about the table, and its light: all of it seen only.

Nothing here has a contact or a mass; the model that rollouts step never has any of it.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from .skins import Finish, paint
from .surface_textures import F64, Color, Surface, brushed, cloth, concrete, laminate, wood

SCENERY_GROUP = 2
"""MuJoCo's visual group of what is only seen."""
WIDE, DEEP, HIGH = 2.4, 2.9, 2.6
"""m: half of the room's width (y), of its depth (x) and its height."""
MIDDLE = 0.6
"""m, x of the room's middle; the robot stands at 0."""

TABLES: tuple[tuple[Surface, Color, Finish], ...] = (
    (wood, (0.82, 0.7, 0.53), Finish(0.15, 0.3)),
    (wood, (0.47, 0.34, 0.24), Finish(0.2, 0.4)),
    (laminate, (0.86, 0.85, 0.82), Finish(0.2, 0.3)),
    (laminate, (0.44, 0.46, 0.49), Finish(0.15, 0.3)),
    (cloth, (0.55, 0.6, 0.66), Finish(0.0, 0.0)),
    (brushed, (0.7, 0.71, 0.73), Finish(0.4, 0.5)),
)
"""Table tops: texture, colour, finish."""
FLOORS: tuple[tuple[Surface, Color, float], ...] = (
    (wood, (0.6, 0.45, 0.3), 0.8),
    (concrete, (0.55, 0.55, 0.54), 2.0),
    (concrete, (0.74, 0.73, 0.7), 1.2),
    (laminate, (0.42, 0.45, 0.5), 0.5),
)
"""Floors: texture, colour, width of one texture tile (m)."""
WALLS: tuple[Color, ...] = (
    (0.86, 0.85, 0.82),
    (0.78, 0.82, 0.84),
    (0.85, 0.8, 0.72),
    (0.72, 0.74, 0.76),
)
THINGS: tuple[Color, ...] = (
    (0.5, 0.38, 0.27),
    (0.3, 0.35, 0.42),
    (0.8, 0.8, 0.78),
    (0.45, 0.5, 0.42),
)
"""Colours of cupboards."""


@dataclass(frozen=True)
class Lamp:
    """A light: where, which way, how bright in red, green and blue."""

    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    color: Color
    shadow: bool


@dataclass(frozen=True)
class Look:
    """One room and its light. The same numbers give the same.

    Attributes:
        seed: numbers that everything was drawn from.
        table: index into ``TABLES``.
        floor: index into ``FLOORS``.
        wall: index into ``WALLS``.
        ambient: share of light that comes from everywhere.
        lamps: the others; the first casts shadows.
    """

    seed: tuple[int, ...]
    table: int
    floor: int
    wall: int
    ambient: Color
    lamps: tuple[Lamp, ...]

    @classmethod
    def drawn(cls, *seed: int) -> Look:
        """The look of an environment seed; more numbers (of the task) make looks of their own.

        Light comes down at 0 to 50 degrees from the vertical and has a colour between that of
        a bulb (about 3,000 K) and of the sky (about 7,500 K); its strength varies by a third.
        """
        rng = np.random.default_rng(seed)
        table, floor, wall = (int(rng.integers(len(of))) for of in (TABLES, FLOORS, WALLS))
        warm, cold = np.array([1.0, 0.86, 0.68]), np.array([0.86, 0.93, 1.0])
        tint = warm + (cold - warm) * rng.random()
        tint /= tint @ (0.3, 0.59, 0.11)
        strength = rng.uniform(0.26, 0.4)
        tilt, turn = np.radians(rng.uniform(0, 50)), rng.uniform(0, 2 * np.pi)
        away = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        key = Lamp(
            _three(0.5 * np.array([1, 0, 0]) + 2.0 * away),
            _three(-away),
            _three(strength * tint),
            True,
        )
        side = -away * (1, 1, 0) + (0, 0, 1.2)
        fill = Lamp(
            _three(np.array([0.5, 0, 0]) + 1.5 * side), _three(-side / np.linalg.norm(side)),
            _three(rng.uniform(0.06, 0.14) * (2 - tint)), False,
        )  # fmt: skip
        ambient = rng.uniform(0.36, 0.44) * (0.5 + 0.5 * tint)
        return cls(tuple(seed), table, floor, wall, _three(ambient), (key, fill))


def look_numbers(task: str, seed: int) -> tuple[int, int]:
    """Seed of the look of a task's scene, equal for all rollouts of an environment seed."""
    return zlib.crc32(task.encode()), seed


def furnish(
    spec: mujoco.MjSpec, look: Look, table: tuple[Sequence[float], Sequence[float]], floor_z: float
) -> None:
    """Add light, sky, floor, walls, a table's top and legs, a pedestal for the arm, cupboards.

    Args:
        spec: a model to be drawn; its own lights, floor and table are to be taken out.
        look: which.
        table: the top's half sizes and middle, m.
        floor_z: m, height of the floor.
    """
    rng = np.random.default_rng([*look.seed, 1])
    world = spec.worldbody
    spec.visual.headlight.ambient = look.ambient
    spec.visual.headlight.diffuse = [0.16, 0.16, 0.16]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.stat.extent, spec.stat.center = 1.0, [0.5, 0.0, 0.1]
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 30.0
    for lamp in look.lamps:
        kind = mujoco.mjtLightType
        world.add_light(
            pos=lamp.position, dir=lamp.direction, diffuse=lamp.color, castshadow=lamp.shadow,
            ambient=[0, 0, 0], specular=[0.35 * c for c in lamp.color], cutoff=60, exponent=1,
            type=kind.mjLIGHT_SPOT if lamp.shadow else kind.mjLIGHT_DIRECTIONAL,
        )  # fmt: skip
    spec.add_texture(
        name="scenery/sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, rgb1=[0.75, 0.8, 0.86], rgb2=[0.5, 0.52, 0.55],
        width=32, height=192,
    )  # fmt: skip
    surface, color, finish = TABLES[look.table]
    half, middle = table
    _thing(spec, "top", half, middle, surface(color, rng), finish, 0.6)
    leg = (float(middle[2]) - float(half[2]) - floor_z) / 2
    for x, y in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        at = (middle[0] + x * (half[0] - 0.05), middle[1] + y * (half[1] - 0.05), floor_z + leg)
        _thing(spec, "frame", (0.025, 0.025, leg), at, (0.5, 0.51, 0.53), METAL)
    foot = -floor_z / 2
    _thing(spec, "pedestal", (0.11, 0.11, foot), (-0.065, 0, -foot), (0.24, 0.25, 0.27), METAL)
    surface, color, wide = FLOORS[look.floor]
    at = (MIDDLE, 0.0, floor_z)  # a plane: as a slab it would shade itself in stripes
    _thing(spec, "floor", (DEEP, WIDE, 0.1), at, surface(color, rng), DULL, wide, plane=True)
    up, far = floor_z + HIGH / 2, 0.05
    for side in (1.0, -1.0):
        at = (MIDDLE + side * (DEEP + far), 0, up)
        _thing(spec, "wall", (far, WIDE, HIGH / 2), at, WALLS[look.wall], DULL)
        at = (MIDDLE, side * (WIDE + far), up)
        _thing(spec, "wall", (DEEP, far, HIGH / 2), at, WALLS[look.wall], DULL)
    for i in range(int(rng.integers(2, 5))):
        color = THINGS[int(rng.integers(len(THINGS)))]
        high, broad, along = (rng.uniform(*span) for span in ((0.4, 0.95), (0.3, 0.6), (-1.5, 1.5)))
        x, y = (
            (MIDDLE + DEEP - 0.25, along), (MIDDLE + along, WIDE - 0.25),
            (MIDDLE + along, -WIDE + 0.25), (MIDDLE - DEEP + 0.25, along),
        )[i]  # fmt: skip
        size = (0.22, broad, high) if i in (0, 3) else (broad, 0.22, high)
        _thing(spec, f"cupboard{i}", size, (x, y, floor_z + high), color, DULL)


METAL, DULL = Finish(0.3, 0.4), Finish(0.0, 0.1)


def _thing(
    spec: mujoco.MjSpec, name: str, half: Sequence[float], at: Sequence[float], picture: F64 | Color,
    finish: Finish, wide: float = 0.0, *, plane: bool = False,
) -> None:  # fmt: skip
    """A box or plane in the world; its texture repeats every ``wide`` m."""
    kind = mujoco.mjtGeom.mjGEOM_PLANE if plane else mujoco.mjtGeom.mjGEOM_BOX
    geom = spec.worldbody.add_geom(
        type=kind, size=half, pos=at, contype=0, conaffinity=0, mass=0, group=SCENERY_GROUP
    )
    paint(spec, geom, f"scenery/{name}", picture, finish, wide)


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
