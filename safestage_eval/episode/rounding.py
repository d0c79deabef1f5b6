"""How coarsely a column was stored, by its own numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

SAMPLE = 256
"""Rows that are looked at first; only where these are coarse, all of them are."""

COARSEST = 1 / 64
"""Share of a number by which rounding to significant digits may change it; bfloat16 does by 1/128."""

FINEST = 1e-5
"""Part of the largest number below which a step is none: single precision may look like it."""

SEEN, LEVELS = 8, (64, 8)
"""A step is at most this part of the largest number, of fewer than so many different ones and of more;
one that is neither a power of two nor of ten has to fit so many."""


SIMPLE = 1 << 21
"""Last bit of 24 in numbers like 1, 0.5 and 5: a few of these show nothing, a normal is mostly (0, 0, 1)."""


class Rounding(NamedTuple):
    """By how much numbers may be off, rounded to the nearest, cut off or rounded up.

    Attributes:
        share: of the number: 2**-10 of a float16.
        step: in the unit of the column: 1/32 where all numbers are multiples of that; 0 if of none.
    """

    share: float
    step: float

    def error(self, values: Any) -> Any:
        """Of each number."""
        return self.share * np.abs(values) + self.step


SINGLE = Rounding(2.0**-23, 0.0)
"""Of a column that shows no coarser one."""


def rounding_of(values: NDArray[Any]) -> Rounding:
    """The rounding that the numbers of a float32 column show: common bits, digits or steps."""
    some = values[:: len(values) // SAMPLE + 1]
    if len(some) < len(values):
        found = _shown(some)
        if found == SINGLE and np.nan_to_num(some).any():
            return found
    return _shown(values)


def most_off(values: NDArray[Any]) -> float:
    """By how much the rounding of a column of vectors may move any of them, in its unit."""
    size = float(np.nanmax(np.abs(values), initial=0.0))
    return float(np.sqrt(values.shape[-1]) * rounding_of(values).error(size))


def _shown(values: NDArray[Any]) -> Rounding:
    sizes = np.unique(np.abs(values[np.isfinite(values)]).astype(np.float32))
    sizes = sizes[sizes >= np.finfo(np.float32).tiny]
    if not len(sizes):
        return SINGLE
    part, power = np.frexp(sizes.astype(np.float64))
    digits = (part * 2.0**24).astype(np.int64)
    last = digits & -digits
    if len(sizes) < SEEN and (last >= SIMPLE).all():
        return SINGLE
    share, step = 2.0**-23 * float(last.min()), float(np.ldexp(last, power - 24).min())
    exact = sizes.astype(np.float64)
    for count in (3, 4):
        tenth = 10.0 ** (count - 1 - np.floor(np.log10(exact)))
        if _whole(exact * tenth, 1e-3):
            share = max(share, 10.0 ** (1 - count))
            break
    most = float(exact[-1])
    step = max(step, _decimal_step(exact), _spacing(exact))
    if step > FINEST * most:
        return Rounding(SINGLE.share, float(min(step, most / LEVELS[len(sizes) >= SEEN])))
    return Rounding(min(share, COARSEST), 0.0)


def _decimal_step(sizes: NDArray[np.float64]) -> float:
    """The power of ten of which all are multiples; 0 if there is none."""
    steps = 10.0 ** -np.arange(7)
    return next((s for s in steps if s > FINEST * sizes[-1] and _whole(sizes / s, 0.02)), 0.0)


def _spacing(sizes: NDArray[np.float64]) -> float:
    """The least difference of two, if all are multiples of it; else 0."""
    step = float(np.diff(sizes, prepend=0.0).min())
    for reach in (64, 1 << 12, 1 << 16):  # the further away, the better a step is known
        near = sizes[sizes < reach * step]
        times = np.rint(near / step)
        step = float(near @ times / (times @ times)) if times.any() else step
    enough = len(sizes) >= SEEN and sizes[-1] < (1 << 16) * step
    return step if enough and _whole(sizes / step, 0.02) else 0.0


def _whole(values: NDArray[np.float64], off: float) -> bool:
    return bool((np.abs(values - np.rint(values)) <= off).all())
