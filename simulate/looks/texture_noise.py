"""Noise that textures are made of: it tiles, and the same seed gives the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Texture = NDArray[np.uint8]
"""(H, W, 3) red green blue; row 0 is its bottom."""
Color = tuple[float, float, float]
"""Red, green, blue, each 0 … 1."""


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


def as_texture(picture: F64) -> Texture:
    """(H, W, 3) bytes of fractions."""
    return np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8)
