"""Whether arguments are of the types that a kernel was compiled for, without asking the compiler.

As strict as numba or stricter: an argument of another type never gets to machine code.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

C_ORDER, F_ORDER, ALIGNED, WRITEABLE = 0x001, 0x002, 0x100, 0x400
"""Bits of ``ndarray.flags.num``."""

LEAST, MOST = -(2**63), 2**63 - 1
"""Range of int64."""

SCALARS: dict[str, tuple[type, type]] = {
    "int64": (int, np.int64), "float64": (float, np.float64), "bool": (bool, np.bool_),
}  # fmt: skip
"""Classes that will do for a scalar."""

Check = Callable[[Sequence[Any]], bool]


def fits(types: list[Any]) -> Check:
    """Return a check of positional arguments: one function for all of them, since each call costs time.

    Args:
        types: as in ``kernel_signatures.json``.

    Raises:
        ValueError: a type that only the compiler can tell.
        ImportError, AttributeError: a named tuple that is no longer there.
    """
    arrays, tuples = [], []
    scalars: list[tuple[int, type, type, bool]] = []
    for place, kind in enumerate(types):
        match kind:
            case str() if kind in SCALARS:
                scalars.append((place, *SCALARS[kind], kind == "int64"))
            case ["array", str(item), int(ndim), str(layout), bool(mutable)]:
                arrays.append((place, np.dtype(item), ndim, *_flags(layout, mutable=mutable)))
            case ["named", str(name), list(items)]:
                module, _, cls = name.partition(":")
                tuples.append((place, getattr(importlib.import_module(module), cls), fits(items)))
            case ["tuple", list(items)]:
                tuples.append((place, tuple, fits(items)))
            case _:
                raise ValueError(f"only numba can tell: {kind}")
    count, array = len(types), np.ndarray

    def check(values: Sequence[Any]) -> bool:
        if len(values) != count:
            return False
        for place, dtype, ndim, bits, wanted in arrays:
            value = values[place]
            if (
                value.__class__ is not array
                or (value.dtype is not dtype and value.dtype != dtype)
                or value.ndim != ndim
                or value.flags.num & bits != wanted
            ):
                return False
        for place, plain, other, bounded in scalars:
            found, value = values[place].__class__, values[place]
            if found is not other and (
                found is not plain or (bounded and not LEAST <= value <= MOST)
            ):
                return False
        for place, cls, suits in tuples:
            if values[place].__class__ is not cls or not suits(values[place]):
                return False
        return True

    return check


def _flags(layout: str, *, mutable: bool) -> tuple[int, int]:
    """Which flags of an array are looked at, and what they have to be."""
    bits = C_ORDER | ALIGNED | WRITEABLE
    wanted = ALIGNED | WRITEABLE * mutable | C_ORDER * (layout == "C")
    if layout != "C":  # a row of numbers in C order is in Fortran's too, and numba calls it C
        bits |= F_ORDER
        wanted |= F_ORDER * (layout == "F")
    return bits, wanted
