"""Pictures that a policy acts from: which cameras, how large, and how they are laid out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]

CAMERAS = ("exterior_left", "wrist")
SIZE = (96, 128)
"""Pixels: height, width."""
EVERY = 3
"""Control steps between two pictures that are trained on: 5 Hz of the 15 Hz of the commands."""


def stacked(images: Mapping[str, NDArray[np.uint8]]) -> U8:
    """(CAMERAS, 3, height, width) of a picture (height, width, 3) of each camera."""
    return np.ascontiguousarray(np.stack([images[name] for name in CAMERAS]).transpose(0, 3, 1, 2))
