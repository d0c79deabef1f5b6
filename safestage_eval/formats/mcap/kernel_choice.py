"""Kernels where their compiler is loaded, else the same by NumPy.

Loading it takes longer than reading a file without it, and 60 MB. Whoever measures shapes has it
loaded.
"""

from __future__ import annotations

import sys
from types import ModuleType


def mcap() -> ModuleType:
    """Functions over the messages of a chunk."""
    if "numba" in sys.modules:
        from . import mcap_kernels

        return mcap_kernels
    from . import mcap_arrays

    return mcap_arrays


def contacts() -> ModuleType:
    """Functions over contact points."""
    if "numba" in sys.modules:
        from . import point_kernels

        return point_kernels
    from . import point_arrays

    return point_arrays
