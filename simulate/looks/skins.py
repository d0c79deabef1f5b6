"""Looks of objects: shells with textures about the shapes that it collides with."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from simulate.catalogue.objects import ObjectModel, Ring, Shape, catalogue

from .object_textures import BOXES, PARTS, ROUND, atlas, carton, covered, kraft, surface
from .shells import F64, Shell, capsule, ellipsoid, revolved, rounded_box, tube
from .texture_noise import Color, Texture, as_texture

BEVEL = 0.002
"""m by which edges of boxes are rounded, at most."""
SOFT = 0.4
"""Share of its smaller half side by which a bar of soap or a toy is rounded."""


GRAIN = 0.15
"""m that a texture is wide on a level disc."""


@dataclass(frozen=True)
class Finish:
    """How light falls on a material: MuJoCo's specular and shininess, opacity, emission, each 0 … 1."""

    specular: float = 0.15
    shininess: float = 0.2
    opacity: float = 1.0
    emission: float = 0.0


FINISHES = {
    "metal": Finish(0.6, 0.6), "steel": Finish(0.6, 0.6), "ceramic": Finish(0.5, 0.9),
    "glass": Finish(0.9, 0.95, 0.38), "bottle": Finish(0.7, 0.8), "plastic": Finish(0.35, 0.5),
    "electronics": Finish(0.5, 0.7), "fruit": Finish(0.3, 0.5), "marble": Finish(0.5, 0.8),
    "soap": Finish(0.3, 0.5), "wood": Finish(0.12, 0.3), "cardboard": Finish(0.1, 0.2),
    "cloth": Finish(0.0, 0.0), "plush": Finish(0.0, 0.0), "felt": Finish(0.0, 0.0),
    "bread": Finish(0.03, 0.1), "paper": Finish(0.05, 0.1), "cork": Finish(0.0, 0.0),
}  # fmt: skip
"""By material; others have the usual one."""
PAINTED = 0.75
"""Opacity at least of what is painted, so that its colour is seen."""
SOLID_GLASS = ("glasses", "picture_frame", "jam_jar")
"""Things of glass and something else, which are not seen through."""


@dataclass(frozen=True)
class Part:
    """A shell in its object's frame, with its texture."""

    shell: Shell
    texture: Texture
    finish: Finish


def catalogue_name(model: ObjectModel) -> str:
    """The name of a model in the catalogue; empty where it is not of it."""
    return next((name for name, other in catalogue().items() if other == model), "")


@lru_cache(maxsize=256)
def skin(name: str, model: ObjectModel, color: Color | None = None) -> tuple[Part, ...]:
    """The parts of an object, none of a region. The same name gives the same skin.

    Args:
        name: what it is in the catalogue: its prints hang on it.
        model: its shapes.
        color: one for all of it instead of its own: its role's.
    """
    if model.region:
        return ()
    finish = FINISHES.get(model.material or "", Finish())
    if name in SOLID_GLASS:
        finish = Finish(0.6, 0.8)
    elif color is not None:
        finish = replace(finish, opacity=max(finish.opacity, PAINTED))
    parts, cup = [], None
    if model.ring is not None:
        cup = _bottom(model)
        paint = as_texture(_round(name, model, color or model.color, _generator(name, -1)))
        parts.append(Part(_cup(model.ring, cup, model), paint, finish))
    handle = _handle(name, model)
    if handle is not None:
        shape = model.shapes[1]
        paint = as_texture(
            surface(model.material, color or shape.color or model.color, _generator(name, 1))
        )
        parts.append(Part(handle, paint, finish))
    for i, shape in enumerate(model.shapes):
        if shape is cup or (handle is not None and i in (1, 2, 3)):
            continue
        seen = color or shape.color or model.color
        rng = _generator(name, i)
        opaque = shape.color is not None and finish.opacity < 1
        shell = _shell(shape, model)
        if shape.kind == "cylinder" and (i > 0 or name not in ROUND):
            shell = _flat_ends(shell)
        paint = as_texture(_paint(name, model, i, seen, rng, painted=color is not None))
        parts.append(
            Part(shell, paint, Finish(finish.specular, finish.shininess) if opaque else finish)
        )
    return tuple(parts)


def _generator(name: str, part: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), part + 1])


def _paint(
    name: str, model: ObjectModel, i: int, color: Color, rng: np.random.Generator, *, painted: bool
) -> F64:
    shape = model.shapes[i]
    if shape.kind == "box":
        cell = PARTS.get((name, i)) or (BOXES.get(name) if i == 0 else None)
        if cell is None and model.material == "cardboard":
            cell = kraft if model.tags else carton
        return atlas(shape.size, color, rng, cell or covered(model.material), painted=painted)
    if i == 0:
        return _round(name, model, color, rng)
    return surface(None if shape.color else model.material, color, rng)


def _round(name: str, model: ObjectModel, color: Color, rng: np.random.Generator) -> F64:
    if name in ROUND:
        return ROUND[name](color, rng)
    picture = surface(model.material, color, rng)
    return picture.transpose(1, 0, 2) if model.material == "wood" else picture


def _shell(shape: Shape, model: ObjectModel) -> Shell:
    s = shape.size
    if shape.kind == "box":
        soft = model.material in ("soap", "plush", "skin", "foam")
        shell = rounded_box(s, SOFT * min(s) if soft else min(BEVEL, 0.25 * min(s)))
    elif shape.kind == "cylinder":
        shell = revolved(_profile(s[0], s[1], _neck(shape, model), model))
    elif shape.kind == "capsule":
        shell = capsule(s[0], s[1])
    else:
        shell = ellipsoid(s if shape.kind == "ellipsoid" else (s[0],) * 3)
    return shell.moved(shape.position, shape.orientation)


def _flat_ends(shell: Shell) -> Shell:
    """A turned profile with the texture laid flat over level discs, where it would run to the middle."""
    level = np.abs(shell.normals[:, 2]) > 0.999
    inside = np.unique(shell.faces[level[shell.faces].all(axis=1)])
    uv = shell.uv.copy()
    uv[inside] = shell.vertices[inside, :2] / GRAIN
    return replace(shell, uv=uv)


def _neck(shape: Shape, model: ObjectModel) -> float | None:
    """Radius of what stands on a cylinder of a bottle, or None."""
    if model.material not in ("bottle", "glass"):
        return None
    top = shape.position[2] + shape.size[1]
    for other in model.shapes:
        on_top = other.kind == "cylinder" and abs(other.position[2] - other.size[1] - top) < 1e-6
        if on_top and 0.2 * shape.size[0] < other.size[0] < 0.8 * shape.size[0]:
            return other.size[0]
    return None


def _profile(
    radius: float, half: float, neck: float | None, model: ObjectModel
) -> list[tuple[float, float]]:
    """Profile of a cylinder: a rounded edge, a can's rims, or a bottle's shoulder."""
    edge = min(0.0015, 0.3 * half, 0.3 * radius)
    low = [(0.0, -half), (radius - edge, -half), (radius, -half + edge)]
    if neck is not None:
        rise = min(1.3 * (radius - neck), 0.7 * half)
        turn = np.linspace(0, np.pi, 12)
        return low + [
            (
                float(neck + (radius - neck) * (1 + np.cos(a)) / 2),
                float(half - rise + rise * a / np.pi),
            )
            for a in turn
        ]
    if model.material == "metal" and 0.02 < radius < 0.05 < 2 * half:
        rim = 0.05 * radius
        return [
            (0.0, -half + rim), (radius - 2 * rim, -half + rim), (radius - 1.5 * rim, -half),
            (radius - rim, -half), (radius, -half + 2 * rim), (radius, half - 2 * rim),
            (radius - rim, half), (radius - 1.5 * rim, half), (radius - 2 * rim, half - rim),
            (0.0, half - rim),
        ]  # fmt: skip
    return [*low, (radius, half - edge), (radius - edge, half), (0.0, half)]


def _bottom(model: ObjectModel) -> Shape | None:
    """The disc that closes a ring from below and is drawn in one with it, if there is one."""
    ring = model.ring
    assert ring is not None
    foot = ring.z - ring.height / 2
    for shape in model.shapes:
        middle = shape.position[:2] == (0.0, 0.0) and shape.orientation == (1.0, 0.0, 0.0, 0.0)
        top, low = shape.position[2] + shape.size[-1], shape.position[2] - shape.size[-1]
        fits = shape.kind == "cylinder" and abs(shape.size[0] - ring.radius) < 0.008
        if (
            middle
            and fits
            and low <= foot + 1e-9
            and -1e-3 < top - foot < 0.03
            and shape.color is None
        ):
            return shape
    return None


def _cup(ring: Ring, bottom: Shape | None, model: ObjectModel) -> Shell:
    """A ring as a wall, in one with its bottom if that is given."""
    outer, inner = ring.radius + ring.thickness / 2, ring.radius - ring.thickness / 2
    low, high = ring.z - ring.height / 2, ring.z + ring.height / 2
    lip = ring.thickness / 2
    turn = np.linspace(0, np.pi, 7)
    edge = [
        (float(ring.radius + lip * np.cos(a)), float(high - lip + lip * np.sin(a))) for a in turn
    ]
    if bottom is None:
        return revolved([(inner, low), (outer, low), *edge, (inner, low)])
    foot = bottom.position[2] - bottom.size[1]
    floor = min(bottom.position[2] + bottom.size[1], high - lip)
    round_ = model.material in ("ceramic", "glass") or (model.material == "wood" and outer > 0.06)
    tuck = min(0.35 * outer, 0.7 * (high - foot)) if round_ else min(0.003, 0.2 * (high - foot))
    bend = np.linspace(0, np.pi / 2, 8)
    outside = [
        (float(outer - tuck * (1 - np.sin(a))), float(foot + tuck * (1 - np.cos(a)))) for a in bend
    ]
    room = min(tuck, 0.9 * (high - lip - floor), 0.9 * inner)
    inside = [
        (float(inner - room * (1 - np.sin(a))), float(floor + room * (1 - np.cos(a))))
        for a in bend[::-1]
    ]
    return revolved([(0.0, foot), *outside, *edge, *inside, (0.0, floor)])


def _handle(name: str, model: ObjectModel) -> Shell | None:
    """A bent handle within the three boxes that stand for it."""
    if name != "coffee_mug" or len(model.shapes) != 4:
        return None
    _, lower, upper, far = (shape.position for shape in model.shapes)
    high, low = max(lower[2], upper[2]), min(lower[2], upper[2])
    middle, reach = (high + low) / 2, (high - low) / 2
    root = model.shapes[1].position[0] - model.shapes[1].size[0]
    angle = np.linspace(-np.pi / 2, np.pi / 2, 16)
    path = np.stack(
        [root + (far[0] - root) * np.cos(angle), 0 * angle, middle + reach * np.sin(angle)], 1
    )
    return tube(path, 0.0045)


def arrays(shell: Shell) -> tuple[Sequence[float], Sequence[float], Sequence[float], Sequence[int]]:
    """Vertices, normals, texture coordinates and faces in one row each, as MuJoCo takes them."""
    return (
        shell.vertices.ravel().tolist(),
        shell.normals.ravel().tolist(),
        shell.uv.ravel().tolist(),
        shell.faces.ravel().tolist(),
    )
