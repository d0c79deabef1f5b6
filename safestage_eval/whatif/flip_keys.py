"""Truths along the axis of one parameter: where the next value lies at which each may change.

A parameter is moved from a value v one way, up or down. A truth at v is written as a key, a float
with a sign: not negative where it is true, negative where it is false, and the larger in size the
further the parameter can move before the truth may change. ``inf`` never changes. *And* is then a
minimum, *or* a maximum and *not* a negation, as for margins (``states.band``), but a key stands for
one exact value of the parameter: the first that may differ.

Values are not negative. Moving up, the key of a value is the value; moving down, the float whose bit
pattern mirrors it, so that the order is turned round and no digit is lost.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from safestage_eval.states.band import F64, Band, Bool

Way = Literal["up", "down"]

LARGEST = float(np.finfo(np.float64).max)
_MIRROR = np.int64(0x7FEFFFFFFFFFFFFF)
"""Bits of ``LARGEST``."""


def mirrored(values: NDArray[np.float64]) -> F64:
    """Floats 0 … LARGEST in the opposite order: 0 ↔ LARGEST; its own inverse."""
    bits = np.ascontiguousarray(np.abs(values), np.float64).view(np.int64)
    return np.asarray((_MIRROR - bits).view(np.float64))


def key_of(value: float, way: Way) -> float:
    """Size of the key of a truth that may change at a value."""
    return value if way == "up" else float(mirrored(np.array([value]))[0])


def value_of(key: float, way: Way) -> float | None:
    """The first value at which a truth with this key may differ; None if it never does."""
    size = abs(key)
    if size == np.inf:
        return None
    return size if way == "up" else float(mirrored(np.array([size]))[0])


def certain(truth: Bool) -> F64:
    """Keys of truths (T,) that do not depend on the parameter."""
    return np.where(truth, np.inf, -np.inf)


def fixed(band: Band) -> Band:
    """A band of margins that do not depend on the parameter, as keys."""
    lower = certain(band.lower >= 0)
    return Band(lower, lower if band.exact else certain(band.upper >= 0))


def changing(truth: Bool, at: F64, flips: Bool, way: Way) -> F64:
    """Keys (T,) of truths that change at the values ``at`` where ``flips``, and never elsewhere.

    Moving down, a value below 0 is never reached.
    """
    if way == "down":
        flips = flips & (at >= 0)
        at = mirrored(np.where(flips, at, 0.0))
    size = np.where(flips, at, np.inf)
    return np.where(truth, size, -size)


def compared(values: F64, op: str, value: float, way: Way, negative: bool) -> F64:
    """Keys (T,) of ``values op parameter``, or of ``values op −parameter``.

    Args:
        values: (T,).
        op: ``>=``, ``>``, ``<=`` or ``<``.
        value: of the parameter.
        way: in which it moves.
        negative: it is compared with the parameter's negative.
    """
    if negative:
        values, op = -values, {">": "<", "<": ">"}[op[0]] + op[1:]
    after, before = np.nextafter(values, np.inf), np.nextafter(values, -np.inf)
    if op == ">=":
        truth, up, down = value <= values, after, values
    elif op == ">":
        truth, up, down = value < values, values, before
    elif op == "<=":
        truth, up, down = value >= values, values, before
    else:
        truth, up, down = value > values, after, values
    # upwards only what is true of small values changes, or what is false of them; downwards the other
    flips = truth == ((op[0] == ">") == (way == "up"))
    return changing(truth, up if way == "up" else down, flips, way)


def clipped(band: Band, size: float) -> Band:
    """Limit the keys of a band to a size: no truth is sure beyond it."""
    lower = _clipped(band.lower, size)
    return Band(lower, lower if band.exact else _clipped(band.upper, size))


def _clipped(keys: F64, size: float) -> F64:
    return np.where(keys >= 0, np.minimum(keys, size), np.maximum(keys, -size))


def steady(band: Band) -> float:
    """Size of the key up to which no truth of a band (T,) changes."""
    least = np.abs(band.lower).min(initial=np.inf)
    return float(least if band.exact else min(least, np.abs(band.upper).min(initial=np.inf)))


def latched(on: F64, keep: F64) -> F64:
    """Keys (T,) of what holds from ``on`` for as long as ``keep`` holds.

    held(t) = (on(t) or held(t − 1)) and keep(t): a chain of clamps, composed by doubling.
    """
    high = keep.copy()
    low = np.minimum(on, keep)
    step = 1
    while step < len(on):
        # the clamp of the later frames after that of the earlier ones
        low[step:], high[step:] = (
            np.minimum(np.maximum(low[:-step], low[step:]), high[step:]),
            np.minimum(np.maximum(high[:-step], low[step:]), high[step:]),
        )
        step *= 2
    return low
