"""A room about the table, its light, and the drawing of skins: all of it seen only.

Nothing here has a contact or a mass; the model that rollouts step never has any of it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from .shells import Shell, rounded_box
from .skins import Finish, Part, arrays
from .surface_textures import (
    Surface,
    brushed,
    cloth,
    concrete,
    laminate,
    planks,
    plaster,
    tiles,
    wood,
)
from .texture_noise import Color, Texture, as_texture

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
    (planks, (0.6, 0.45, 0.3), 0.8),
    (concrete, (0.55, 0.55, 0.54), 2.0),
    (tiles, (0.74, 0.73, 0.7), 1.2),
    (laminate, (0.42, 0.45, 0.5), 0.5),
)
"""Floors: texture, colour, width of one texture tile (m)."""
WALLS: tuple[Color, ...] = (
    (0.86, 0.85, 0.82),
    (0.78, 0.82, 0.84),
    (0.85, 0.8, 0.72),
    (0.72, 0.74, 0.76),
)
THINGS: tuple[tuple[Surface, Color], ...] = (
    (wood, (0.5, 0.38, 0.27)),
    (laminate, (0.3, 0.35, 0.42)),
    (laminate, (0.8, 0.8, 0.78)),
    (laminate, (0.45, 0.5, 0.42)),
)
"""Cupboards: texture, colour."""


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
    _slab(spec, "scenery/top", half, middle, surface(color, rng), 0.6, finish)
    frame = brushed((0.5, 0.51, 0.53), rng)
    under = float(middle[2]) - float(half[2])
    leg = (under - floor_z) / 2
    for i, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        at = (middle[0] + x * (half[0] - 0.05), middle[1] + y * (half[1] - 0.05), floor_z + leg)
        _slab(spec, f"scenery/leg{i}", (0.025, 0.025, leg), at, frame, 0.5, Finish(0.3, 0.4))
    foot = -floor_z / 2
    dark = brushed((0.24, 0.25, 0.27), rng)
    _slab(
        spec,
        "scenery/pedestal",
        (0.11, 0.11, foot),
        (-0.065, 0, -foot),
        dark,
        0.6,
        Finish(0.3, 0.4),
    )
    surface, color, wide = FLOORS[look.floor]
    far = 0.05
    paint(spec, "scenery/floor", as_texture(surface(color, rng)), Finish(0.1, 0.3), 1 / wide)
    world.add_geom(  # a plane: as a slab it would shade itself in stripes
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[DEEP, WIDE, 0.1], pos=[MIDDLE, 0, floor_z],
        material="scenery/floor", contype=0, conaffinity=0, group=SCENERY_GROUP, rgba=[1, 1, 1, 1],
    )  # fmt: skip
    wall = plaster(WALLS[look.wall], rng)
    up = floor_z + HIGH / 2
    sides = (
        ((far, WIDE, HIGH / 2), (MIDDLE + DEEP + far, 0, up)),
        ((far, WIDE, HIGH / 2), (MIDDLE - DEEP - far, 0, up)),
        ((DEEP, far, HIGH / 2), (MIDDLE, WIDE + far, up)),
        ((DEEP, far, HIGH / 2), (MIDDLE, -WIDE - far, up)),
    )
    for i, (size, at) in enumerate(sides):
        _slab(spec, f"scenery/wall{i}", size, at, wall, 2.0, Finish(0.0, 0.0, emission=0.3))
        skirting = [s if s > far else far + 0.01 for s in size[:2]]
        _slab(
            spec, f"scenery/skirting{i}", (*skirting, 0.05), (at[0], at[1], floor_z + 0.05),
            laminate((0.9, 0.9, 0.88), rng), 1.0, Finish(0.1, 0.2),
        )  # fmt: skip
    _cupboards(spec, rng, floor_z)


def _cupboards(spec: mujoco.MjSpec, rng: np.random.Generator, floor_z: float) -> None:
    """Two to four cupboards or shelves along the walls, and a board on one."""
    for i in range(int(rng.integers(2, 5))):
        surface, color = THINGS[int(rng.integers(len(THINGS)))]
        high, wide = rng.uniform(0.4, 0.95), rng.uniform(0.3, 0.6)
        along = rng.uniform(-1.5, 1.5)
        wall = i % 4
        at = (
            (MIDDLE + DEEP - 0.25, along), (MIDDLE + along, WIDE - 0.25),
            (MIDDLE + along, -WIDE + 0.25), (MIDDLE - DEEP + 0.25, along),
        )[wall]  # fmt: skip
        deep = 0.22
        size = (deep, wide, high) if wall in (0, 3) else (wide, deep, high)
        _slab(
            spec,
            f"scenery/cupboard{i}",
            size,
            (*at, floor_z + high),
            surface(color, rng),
            0.8,
            Finish(0.1, 0.3),
        )
    board = (0.02, rng.uniform(0.5, 0.9), 0.4)
    hangs = (MIDDLE + DEEP - 0.02, rng.uniform(-0.8, 0.8), floor_z + 1.75)
    _slab(
        spec,
        "scenery/board",
        board,
        hangs,
        laminate((0.93, 0.94, 0.95), rng),
        1.0,
        Finish(0.3, 0.5),
    )


def _slab(
    spec: mujoco.MjSpec, name: str, half: Sequence[float], at: Sequence[float], picture: Any,
    wide: float, finish: Finish,
) -> None:  # fmt: skip
    """A box in the world whose texture repeats every ``wide`` m on each side."""
    shell = rounded_box(half, 0.002)
    corner = shell.vertices
    flat = np.abs(shell.normals).argmax(axis=1)
    across = np.where(flat == 0, corner[:, 1], corner[:, 0])
    up = np.where(flat == 2, corner[:, 1], corner[:, 2])
    uv = np.stack([across, up], 1) / wide
    if half[1] > half[0]:
        level = flat == 2  # grain along the longer side
        uv[level] = uv[level][:, ::-1]
    part = Part(Shell(corner, shell.normals, uv, shell.faces), as_texture(picture), finish)
    dress(spec, spec.worldbody, name, [part], at)


def dress(
    spec: mujoco.MjSpec, body: Any, name: str, parts: Iterable[Part],
    at: Sequence[float] = (0.0, 0.0, 0.0), opacity: float = 1.0, group: int = SCENERY_GROUP,
) -> None:  # fmt: skip
    """Hang shells on a body of a model to be drawn, at a place in its frame.

    ``name`` begins the names of what is added, and must be unique in the model.
    """
    for i, part in enumerate(parts):
        key = f"{name}/skin{i}"
        vertices, normals, uv, faces = arrays(part.shell)
        spec.add_mesh(
            name=key, uservert=vertices, usernormal=normals, usertexcoord=uv, userface=faces,
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )  # fmt: skip
        paint(spec, key, part.texture, part.finish)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=key, material=key, pos=at,
            contype=0, conaffinity=0, mass=0, group=group,
            rgba=[1, 1, 1, part.finish.opacity * opacity],
        )  # fmt: skip


def paint(
    spec: mujoco.MjSpec, key: str, picture: Texture, finish: Finish, repeat: float | None = None
) -> None:
    """Add a texture and a material of that name; ``repeat``: times per metre, of a plane."""
    height, width, _ = picture.shape
    texture = spec.add_texture(
        name=key, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
    )
    texture.data = picture.tobytes()
    material = spec.add_material(
        name=key, specular=finish.specular, shininess=finish.shininess, emission=finish.emission
    )
    if repeat is not None:
        material.texuniform, material.texrepeat = True, [repeat, repeat]
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = key


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
