"""Textures of surfaces: wood, laminate, cloth, concrete, tiles, brushed metal and the like.

Each function gives (SIDE, SIDE, 3) fractions that tile, made from a colour and a random generator.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .texture_noise import F64, Color, blended, fractal, grid, shaded

SIDE = 128
"""Pixels of a texture's side."""
SIZE = (SIDE, SIDE)

Surface = Callable[[Color, np.random.Generator], F64]


def wood(color: Color, rng: np.random.Generator) -> F64:
    """Grain along x: rings cut lengthwise, with pores."""
    bend = fractal(rng, SIZE, slope=2.0, stretch=(1.0, 6.0))
    y, _ = grid(SIZE)
    rings = np.sin(2 * np.pi * (5 * y + 0.5 * bend))
    pores = fractal(rng, SIZE, slope=0.6, stretch=(1.0, 14.0))
    return shaded(color, 1.0 + 0.09 * rings + 0.08 * pores + 0.05 * bend)


def planks(color: Color, rng: np.random.Generator) -> F64:
    """Floor boards along x, four to a tile, each of a shade of its own."""
    out = wood(color, rng)
    y, x = grid(SIZE)
    board = (4 * y).astype(int)
    shade = 1 + 0.1 * rng.standard_normal(8)
    ends = (x + 0.37 * board) % 1.0
    out = out * shade[board + 4 * (ends > 0.5)][..., None]
    gap = ((4 * y) % 1 < 0.05) | (np.abs(ends - 0.5) < 0.006) | (ends < 0.006)
    return blended(out, np.multiply(color, 0.35), 0.8 * gap)


def laminate(color: Color, rng: np.random.Generator) -> F64:
    """Even, finely speckled."""
    return shaded(color, 1 + 0.02 * fractal(rng, SIZE, slope=0.3) + 0.015 * fractal(rng, SIZE))


def cloth(color: Color, rng: np.random.Generator) -> F64:
    """A plain weave."""
    y, x = grid(SIZE)
    over = np.sin(2 * np.pi * 32 * x) * np.sin(2 * np.pi * 32 * y)
    return shaded(color, 1 + 0.1 * over + 0.06 * fractal(rng, SIZE, slope=0.5))


def concrete(color: Color, rng: np.random.Generator) -> F64:
    """Cloudy, with small pits."""
    cloud, grain = fractal(rng, SIZE, slope=1.4), fractal(rng, SIZE, slope=0.2)
    return shaded(color, 1 + 0.08 * cloud + 0.04 * grain - 0.25 * (grain > 1.15))


def plaster(color: Color, rng: np.random.Generator) -> F64:
    """A painted wall."""
    return shaded(color, 1 + 0.025 * fractal(rng, SIZE, slope=0.8))


def tiles(color: Color, rng: np.random.Generator) -> F64:
    """Square tiles, four by four, with joints."""
    y, x = grid(SIZE)
    number = (4 * y).astype(int) * 4 + (4 * x).astype(int)
    shade = 1 + 0.04 * rng.standard_normal(16)
    out = shaded(color, shade[number] + 0.03 * fractal(rng, SIZE, slope=1.2))
    joint = ((4 * y) % 1 < 0.06) | ((4 * x) % 1 < 0.06)
    return blended(out, np.multiply(color, 0.6), 0.9 * joint)


def brushed(color: Color, rng: np.random.Generator) -> F64:
    """Metal with fine scratches along x."""
    return shaded(color, 1 + 0.1 * fractal(rng, SIZE, slope=0.2, stretch=(1.0, 40.0)))


def marble(color: Color, rng: np.random.Generator) -> F64:
    """Veins in a pale stone."""
    bend = fractal(rng, SIZE, slope=1.8)
    vein = np.exp(-((np.abs(bend) / 0.06) ** 2))
    return blended(shaded(color, 1 + 0.03 * bend), np.multiply(color, 0.55), 0.6 * vein)


def mottled(color: Color, rng: np.random.Generator) -> F64:
    """Peel of fruit: patches towards yellow, and pores."""
    warm = np.clip(np.multiply(color, (1.05, 1.35, 0.9)), 0, 1)
    patch = fractal(rng, SIZE, slope=1.5)
    pores = fractal(rng, SIZE, slope=0.1)
    return blended(shaded(color, 1 - 0.06 * (pores > 0.7)), warm, 0.5 * np.clip(patch, 0, 1))


def speckled(color: Color, rng: np.random.Generator) -> F64:
    """Egg shell, cork, soap: fine dark grains on even ground."""
    grain = fractal(rng, SIZE, slope=0.3)
    return shaded(color, 1 + 0.02 * fractal(rng, SIZE) - 0.12 * np.clip(grain - 0.5, 0, 1))


def cork(color: Color, rng: np.random.Generator) -> F64:
    """Grains of cork."""
    grain = fractal(rng, SIZE, slope=0.5, finest=40)
    return shaded(color, 1 + 0.14 * grain - 0.3 * (grain > 0.95))


def fuzzy(color: Color, rng: np.random.Generator) -> F64:
    """Plush and felt."""
    return shaded(color, 1 + 0.13 * fractal(rng, SIZE, slope=0.2) + 0.05 * fractal(rng, SIZE))


def crusty(color: Color, rng: np.random.Generator) -> F64:
    """Bread: brown on top of pale, floured."""
    bake, flour = fractal(rng, SIZE, slope=1.3), fractal(rng, SIZE, slope=0.8)
    out = blended(shaded(color, 1 + 0.1 * bake), np.multiply(color, 0.6), 0.6 * np.clip(bake, 0, 1))
    return blended(out, (0.97, 0.93, 0.84), 0.5 * np.clip(flour - 0.5, 0, 1))


def wicker(color: Color, rng: np.random.Generator) -> F64:
    """Woven rods."""
    y, x = grid(SIZE)
    flip = ((8 * x).astype(int) + (16 * y).astype(int)) % 2
    rod = np.abs(np.sin(np.pi * 16 * y)) * np.abs(np.sin(np.pi * (8 * x + 0.5 * flip))) ** 0.4
    return shaded(color, 0.55 + 0.6 * rod + 0.05 * fractal(rng, SIZE, slope=0.4))


def smooth(color: Color, rng: np.random.Generator) -> F64:
    """Plastic, glaze, paint: all but even."""
    return shaded(color, 1 + 0.012 * fractal(rng, SIZE, slope=1.2))


SURFACES: dict[str, Surface] = {
    "wood": wood, "metal": brushed, "steel": brushed, "cloth": cloth, "stone": concrete,
    "marble": marble, "fruit": mottled, "egg": speckled, "soap": speckled, "cork": cork,
    "plush": fuzzy, "felt": fuzzy, "foam": speckled, "bread": crusty, "wicker": wicker,
    "cardboard": laminate, "paper": laminate, "skin": speckled,
}  # fmt: skip
"""Material of an object → its surface; others are ``smooth``."""
