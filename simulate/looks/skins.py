"""Looks of objects: the shapes that it collides with, in the textures of its materials and prints."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from simulate.catalogue.objects import ObjectModel, Shape, catalogue

from .object_textures import PRINTS, carton, cube_texture, kraft
from .surface_textures import F64, SURFACES, Color


@dataclass(frozen=True)
class Finish:
    """How light falls on a material: MuJoCo's specular and shininess, and opacity, each 0 … 1."""

    specular: float = 0.15
    shininess: float = 0.2
    opacity: float = 1.0


FINISHES = {
    "metal": Finish(0.6, 0.6), "steel": Finish(0.6, 0.6), "ceramic": Finish(0.5, 0.9),
    "glass": Finish(0.9, 0.95, 0.38), "bottle": Finish(0.7, 0.8), "plastic": Finish(0.35, 0.5),
    "electronics": Finish(0.5, 0.7), "fruit": Finish(0.3, 0.5), "marble": Finish(0.5, 0.8),
    "soap": Finish(0.3, 0.5), "cloth": Finish(0.0, 0.0), "plush": Finish(0.0, 0.0),
    "felt": Finish(0.0, 0.0), "cork": Finish(0.0, 0.0),
}  # fmt: skip
"""By material; others have the usual one."""
PAINTED = 0.75
"""Opacity at least of what is painted, so that its colour is seen."""
SOLID_GLASS = ("glasses", "picture_frame", "jam_jar")
"""Things of glass and something else, which are not seen through."""


def catalogue_name(model: ObjectModel) -> str:
    """The name of a model in the catalogue; empty where it is not of it."""
    return next((name for name, other in catalogue().items() if other == model), "")


def paint_shapes(
    spec: mujoco.MjSpec,
    geoms: Sequence[Any],
    key: str,
    name: str,
    model: ObjectModel,
    color: Color | None = None,
    opacity: float = 1.0,
) -> None:
    """Paint the geoms of an object's body. The same name gives the same paint.

    Args:
        spec: a model to be drawn.
        geoms: the body's, in the order of ``model.parts()``.
        key: begins the names of what is added, and must be unique in the model.
        name: what it is in the catalogue: its prints hang on it.
        model: its shapes.
        color: one for all of it instead of its own: its role's.
        opacity: 0 (unseen) … 1.
    """
    finish = FINISHES.get(model.material or "", Finish())
    through = finish.opacity if color is None else max(finish.opacity, PAINTED)
    if name in SOLID_GLASS:
        through = 1.0
    for i, (geom, shape) in enumerate(zip(geoms, model.parts(), strict=True)):
        seen = color or shape.color or model.color
        solid = 1.0 if shape.color is not None else through
        picture = _picture(name, model, i, shape, seen, painted=color is not None)
        part = min(i, len(model.shapes))  # the boxes of a ring are all alike
        paint(spec, geom, f"{key}/paint{part}", picture if picture is not None else seen, finish)
        geom.rgba = [*geom.rgba[:3], solid * opacity]


def paint(
    spec: mujoco.MjSpec,
    geom: Any,
    key: str,
    picture: F64 | Color,
    finish: Finish,
    wide: float = 0.0,
) -> None:
    """Give a geom a colour, or a texture of a name: a cube's, or one that repeats every ``wide`` m."""
    geom.rgba = [*picture, 1] if isinstance(picture, tuple) else [1, 1, 1, 1]
    geom.material = key
    if spec.material(key) is not None:
        return
    material = spec.add_material(name=key, specular=finish.specular, shininess=finish.shininess)
    if isinstance(picture, tuple):
        return
    kind = mujoco.mjtTexture.mjTEXTURE_2D if wide else mujoco.mjtTexture.mjTEXTURE_CUBE
    height, width, _ = picture.shape
    texture = spec.add_texture(name=key, type=kind, width=width, height=height, nchannel=3)
    texture.data = np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8).tobytes()
    if wide:
        material.texuniform, material.texrepeat = True, [1 / wide, 1 / wide]
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = key


def _picture(
    name: str, model: ObjectModel, i: int, shape: Shape, color: Color, *, painted: bool
) -> F64 | None:
    """The texture of a shape: its print, or that of its material, or none."""
    rng = np.random.default_rng([zlib.crc32(name.encode()), i])
    cell = PRINTS.get((name, i))
    if cell is None and model.material == "cardboard" and shape.kind == "box":
        cell = kraft if model.tags else carton
    if cell is not None:
        half = shape.size if shape.kind == "box" else (shape.size[0], *shape.size)
        return cube_texture([*half, *half][:3], color, rng, cell, painted=painted)
    surface = None if shape.color else SURFACES.get(model.material or "")
    return None if surface is None or i >= len(model.shapes) > 0 else surface(color, rng)
