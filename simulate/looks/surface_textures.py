"""Textures of surfaces, and the noise that they are made of: wood, cloth, concrete, brushed metal and the like.

Each gives (SIDE, SIDE, 3) fractions that tile, made from a colour and a random generator; the same seed gives the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Color = tuple[float, float, float]
"""Red, green, blue, each 0 … 1."""
SIDE = 128
"""Pixels of a texture's side."""
SIZE = (SIDE, SIDE)

Surface = Callable[[Color, np.random.Generator], F64]


def fractal(
    rng: np.random.Generator,
    size: tuple[int, int],
    *,
    slope: float = 1.5,
    stretch: tuple[float, float] = (1.0, 1.0),
    finest: float | None = None,
) -> F64:
    """(H, W) noise, mean 0 and mostly within ±1, whose amplitude falls with frequency.

    Args:
        rng: what it is drawn from.
        size: H, W in pixels.
        slope: exponent of the fall; 0 is white noise, 2 is cloudy.
        stretch: how much longer its features are along rows' and columns' direction (y, x).
        finest: cycles per picture above which there is nothing; all where None.
    """
    height, width = size
    down = np.fft.fftfreq(height)[:, None] * height * stretch[0]
    along = np.fft.rfftfreq(width)[None, :] * width * stretch[1]
    frequency = np.hypot(down, along)
    frequency[0, 0] = np.inf
    gain = frequency**-slope
    if finest is not None:
        gain *= frequency <= finest
    drawn = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(size)) * gain, s=size)
    return np.clip(drawn / max(float(drawn.std()), 1e-12) / 2, -1.5, 1.5)


def grid(size: tuple[int, int]) -> tuple[F64, F64]:
    """(H, W) each: y and x of every pixel's middle, 0 … 1 from bottom and left."""
    y, x = ((np.arange(n) + 0.5) / n for n in size)
    return np.repeat(y[:, None], size[1], 1), np.repeat(x[None, :], size[0], 0)


def shaded(color: Sequence[float] | NDArray[Any], brightness: NDArray[Any]) -> F64:
    """(H, W, 3): a colour times a brightness (H, W) about 1."""
    out: F64 = np.asarray(color, float) * brightness[..., None]
    return out


def blended(under: F64, over: Sequence[float] | NDArray[Any], share: NDArray[Any]) -> F64:
    """(H, W, 3): ``over`` laid on ``under`` with a share (H, W) of 0 … 1."""
    out: F64 = under + (np.asarray(over, float) - under) * np.clip(share, 0, 1)[..., None]
    return out


def wood(color: Color, rng: np.random.Generator) -> F64:
    """Grain along x: rings cut lengthwise, with pores."""
    bend = fractal(rng, SIZE, slope=2.0, stretch=(1.0, 6.0))
    y, _ = grid(SIZE)
    rings = np.sin(2 * np.pi * (5 * y + 0.5 * bend))
    pores = fractal(rng, SIZE, slope=0.6, stretch=(1.0, 14.0))
    return shaded(color, 1.0 + 0.09 * rings + 0.08 * pores + 0.05 * bend)


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


SURFACES: dict[str, Surface] = {
    "wood": wood, "metal": brushed, "steel": brushed, "cloth": cloth, "stone": concrete,
    "marble": marble, "fruit": mottled, "egg": speckled, "soap": speckled, "cork": cork,
    "plush": fuzzy, "felt": fuzzy, "foam": speckled, "bread": crusty, "wicker": wicker,
    "skin": speckled,
}  # fmt: skip
"""Material of an object → its surface; others have none."""
