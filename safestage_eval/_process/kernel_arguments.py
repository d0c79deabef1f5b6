"""Whether arguments are of the types that a kernel was compiled for, without asking the compiler.

As strict as numba or stricter: an argument of another type never gets to machine code.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from operator import call
from typing import Any

import numpy as np

Check = Callable[[Any], bool]

C_ORDER, F_ORDER, ALIGNED, WRITEABLE = 0x001, 0x002, 0x100, 0x400
"""Bits of ``ndarray.flags.num``."""

LEAST, MOST = -(2**63), 2**63 - 1
"""Range of int64."""


def fits(types: list[Any]) -> Callable[[tuple[Any, ...]], bool]:
    """Return a check of positional arguments.

    Args:
        types: as in ``kernel_signatures.json``.

    Raises:
        ValueError: a type that only the compiler can tell.
        ImportError, AttributeError: a named tuple that is no longer there.
    """
    return _all(tuple(map(_check, types)))


def _check(kind: Any) -> Check:
    match kind:
        case "int64":
            return lambda value: (
                (value.__class__ is int and LEAST <= value <= MOST) or value.__class__ is np.int64
            )
        case "float64":
            return lambda value: value.__class__ is float or value.__class__ is np.float64
        case "bool":
            return lambda value: value.__class__ is bool or value.__class__ is np.bool_
        case ["array", str(item), int(ndim), str(layout), bool(mutable)]:
            return _array(np.dtype(item), ndim, layout, mutable=mutable)
        case ["named", str(name), list(items)]:
            module, _, cls = name.partition(":")
            return _tuple(getattr(importlib.import_module(module), cls), items)
        case ["tuple", list(items)]:
            return _tuple(tuple, items)
    raise ValueError(f"only numba can tell: {kind}")


def _array(dtype: np.dtype[Any], ndim: int, layout: str, *, mutable: bool) -> Check:
    bits = C_ORDER | ALIGNED | WRITEABLE
    wanted = ALIGNED | WRITEABLE * mutable | C_ORDER * (layout == "C")
    if layout != "C":  # a row of numbers in C order is in Fortran's too, and numba calls it C
        bits |= F_ORDER
        wanted |= F_ORDER * (layout == "F")

    def check(value: Any) -> bool:
        return (
            value.__class__ is np.ndarray
            and value.dtype == dtype
            and value.ndim == ndim
            and value.flags.num & bits == wanted
        )

    return check


def _tuple(cls: type, items: list[Any]) -> Check:
    check = _all(tuple(map(_check, items)))
    return lambda value: value.__class__ is cls and check(value)


def _all(checks: tuple[Check, ...]) -> Check:
    count = len(checks)
    return lambda values: len(values) == count and all(map(call, checks, values))
