"""Camera images in the sizes that models want."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""(H, W, 3), red green blue."""


def resize_with_pad(image: Image, height: int, width: int) -> Image:
    """An image scaled to fit, in the middle of black, as ``tf.image.resize_with_pad`` does.

    Bilinear over the area that a pixel covers; the scaled size is rounded down, and of an odd
    remainder the larger part comes after. So the published clients do it (openpi-client 0.1.2).

    Args:
        image: (H, W, 3).
        height: pixels of the result.
        width: pixels of the result.
    """
    from PIL import Image as Pictures

    high, wide = image.shape[:2]
    if (high, wide) == (height, width):
        return np.ascontiguousarray(image)
    ratio = max(wide / width, high / height)
    size = int(wide / ratio), int(high / ratio)
    scaled = Pictures.fromarray(np.ascontiguousarray(image)).resize(
        size, resample=Pictures.Resampling.BILINEAR
    )
    out = np.zeros((height, width, 3), np.uint8)
    top, left = (height - size[1]) // 2, (width - size[0]) // 2
    out[top : top + size[1], left : left + size[0]] = np.asarray(scaled)
    return out


def halved(image: Image) -> Image:
    """(H / 2, W / 2, 3): means of blocks of 2 × 2 pixels, rounded down; H and W even."""
    high, wide = image.shape[:2]
    blocks = image.reshape(high // 2, 2, wide // 2, 2, 3).astype(np.uint16)
    return np.asarray(blocks.sum(axis=(1, 3)) // 4, np.uint8)


def composite(wrist: Image, left: Image, right: Image) -> Image:
    """(3 H / 2, W, 3): the wrist's view above, the two outer views at half size below it.

    All three are (H, W, 3).
    """
    return np.concatenate([wrist, np.concatenate([halved(left), halved(right)], axis=1)])
