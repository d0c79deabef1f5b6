"""How far a quantity is from a limit, as a margin."""

from __future__ import annotations

import numpy as np

from safestage_eval._process.compiled import kernel

from .band import F64, TINY, strict


def limit_margin(value: F64, limit: float, size: float, *, up: bool, open_: bool) -> F64:
    """(T,) margin of ``value >= limit`` (up) or ``value <= limit``, in units of ``size``.

    ``open_``: the comparison is strict, and a margin of exactly 0 is not enough.
    """
    if not value.flags.carray or value.dtype != np.float64:
        return limit_margin_slowly(value, limit, size, up=up, open_=open_)
    out = np.empty(len(value))
    _limit_margin(value, float(limit), float(size), up, open_, out)
    return out


def limit_margin_slowly(value: F64, limit: float, size: float, *, up: bool, open_: bool) -> F64:
    """Compute ``limit_margin`` with NumPy, for arrays that the kernel does not take."""
    margin = value - limit if up else limit - value
    margin /= size
    return strict(margin) if open_ else margin


@kernel
def _limit_margin(value: F64, limit: float, size: float, up: bool, open_: bool, out: F64) -> None:
    if up:
        for t in range(len(value)):
            found = (value[t] - limit) / size
            out[t] = -TINY if open_ and found == 0.0 else found
    else:
        for t in range(len(value)):
            found = (limit - value[t]) / size
            out[t] = -TINY if open_ and found == 0.0 else found
