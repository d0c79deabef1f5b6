"""How smooth a motion is, by the length of its spectrum: SPARC.

Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, On the analysis of movement smoothness,
Journal of NeuroEngineering and Rehabilitation 12:112 (2015), with the values that they give: the
spectrum up to 10 Hz, or up to where it last reaches 5 % of its greatest magnitude, padded four times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

CUTOFF = 10.0
"""Hz, up to where the spectrum counts at most."""
SHARE = 0.05
"""Share of the greatest magnitude: the spectrum counts up to where it last reaches this."""
PADDED = 4
"""How many times as long as the next power of two the transform is."""
AT_REST = 1e-6
"""SI per second or so: below this nothing has moved, and the spectrum is one of rounding."""


def sparc(speed: F64, dt: float) -> float | None:
    """The negative length of the normalised magnitude spectrum of a speed, its frequencies by the cutoff.

    Args:
        speed: (N,) at even spacing, not negative.
        dt: s, the spacing.

    Returns:
        No more than 0; the lower, the less smooth. None of what has not moved, or of one sample.
    """
    if len(speed) < 2 or np.abs(speed).max() < AT_REST:
        return None
    padded = PADDED * 2 ** int(np.ceil(np.log2(len(speed))))
    magnitude = np.abs(np.fft.rfft(speed, padded))
    magnitude /= magnitude.max()
    frequency = np.fft.rfftfreq(padded, dt)
    cutoff = min(float(frequency[np.flatnonzero(magnitude >= SHARE)[-1]]), CUTOFF)
    counted = int(np.searchsorted(frequency, cutoff, "right"))
    if counted < 2:
        return 0.0
    across = np.diff(frequency[:counted]) / cutoff
    return -float(np.hypot(across, np.diff(magnitude[:counted])).sum())
