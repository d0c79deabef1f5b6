"""SciPy's linear algebra, which numba loads for kernels that multiply matrices: none here does."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

_ASKED_FOR, _ASKS = "scipy.linalg", "numba.np.arraymath"


@cache
def postpone() -> None:
    """Load it when a kernel wants it; call this with numba loaded, before the first kernel.

    As its first kernel is looked up, numba tries whether ``scipy.linalg`` is there, and so imports
    it: a tenth of what a process does up to its first verdict. Here it is told no, that once. Whoever
    compiles a product of matrices in the same process has it imported then.
    """
    from numba.core.cpu import CPUContext

    look_up = CPUContext.load_additional_registries

    def quickly(context: Any) -> None:
        if _ASKED_FOR in sys.modules or _ASKS in sys.modules:
            look_up(context)
            return
        sys.modules[_ASKED_FOR] = None  # type: ignore[assignment]
        try:
            look_up(context)
        finally:
            del sys.modules[_ASKED_FOR]
            CPUContext.load_additional_registries = look_up
        sys.modules[_ASKS]._HAVE_BLAS = True  # type: ignore[attr-defined]  # noqa: SLF001

    if _ASKS not in sys.modules:
        CPUContext.load_additional_registries = quickly
