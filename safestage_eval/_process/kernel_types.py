"""Types of kernel arguments as JSON, and back."""

from __future__ import annotations

import importlib
from typing import Any

import numba
import numpy as np

types: Any = numba.types


def to_json(kind: Any) -> Any:
    """A scalar as its name, anything else as a list that begins with what it is.

    Raises:
        TypeError: a type that no kernel was ever called with.
    """
    match kind:
        case types.Omitted():
            return ["default", kind.value]
        case types.Number() | types.Boolean():
            return str(kind)
        case types.Array():
            return ["array", to_json(kind.dtype), kind.ndim, kind.layout, kind.mutable]
        case types.NamedTuple() | types.NamedUniTuple():
            name = f"{kind.instance_class.__module__}:{kind.instance_class.__name__}"
            return ["named", name, [to_json(item) for item in kind.types]]
        case types.BaseTuple():
            return ["tuple", [to_json(item) for item in kind.types]]
    raise TypeError(f"no kernel takes {kind}")


def from_json(data: Any) -> Any:
    """The type. Raises ImportError or AttributeError where a named tuple is no longer there."""
    match data:
        case str():
            return numba.from_dtype(np.dtype(data))
        case ["default", value]:
            return types.Omitted(value)
        case ["array", item, ndim, layout, mutable]:
            return types.Array(from_json(item), ndim, layout, readonly=not mutable)
        case ["named", str(name), items]:
            module, _, cls = name.partition(":")
            named = getattr(importlib.import_module(module), cls)
            return types.BaseTuple.from_types([from_json(item) for item in items], named)
        case ["tuple", items]:
            return types.BaseTuple.from_types([from_json(item) for item in items])
    raise TypeError(f"no type: {data}")
